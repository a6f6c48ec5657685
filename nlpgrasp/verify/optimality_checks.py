"""Check of a stated local optimum, as far as it is possible without the program."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.numeric_bodies import FacedSurface, SmoothSurface
from nlpgrasp.verify.stated_placement import NumericBody

SUM, BINDING = 1e-5, 1e-5  # tolerances: sum of the weights; relative spread of binding inequalities
ABOVE = 2e-3  # largest relative excess of the program's beta over mu
SLOPE = 1e-4  # share of mu: largest first-order gain of a free contact over the body's size
STEP, FREE = 1e-6, 1e-3  # shares of the body's size: difference step; least distance of a free contact from edges


def optimality_checks(solution: GraspSolution, grasp: Grasp, surface: NumericBody | None, size: float) -> list[Check]:
    """Return the checks that stated inequalities bind equally at mu, and that free contacts cannot raise it.

    Contacts of a hand with joints, and those in active constraints, are not free and not checked.
    """
    kkt = solution.kkt
    if kkt is None:
        return []
    wrong = [*_weight_errors(solution, grasp, kkt)]
    if not wrong and kkt.is_small and surface is not None:
        wrong += [*_contact_errors(solution, grasp, kkt, surface, size)]
    return [Check("local optimum", not wrong, "; ".join(wrong) if wrong else kkt.words)]


def _weight_errors(solution: GraspSolution, grasp: Grasp, kkt: KKT) -> Iterator[str]:
    weights = np.array(kkt.weights)
    if len(kkt.directions) != len(weights) or any(len(y) != grasp.dimension for y in kkt.directions):
        yield f"{len(kkt.directions)} directions of dimension {grasp.dimension} for {len(weights)} weights"
    elif kkt.is_small and not len(weights):
        yield "a local optimum along no direction"
    elif len(weights) and (np.min(weights) < 0.0 or abs(np.sum(weights) - 1.0) > SUM):
        yield f"weights from {np.min(weights):.3g} with a sum of {np.sum(weights):.9g}"
    elif kkt.is_small:
        ratios = _recomputed_ratios(solution, grasp, kkt)
        beta = float(weights @ ratios)
        unequal = float(np.max(weights * np.abs(ratios - beta))) / beta
        if not unequal <= BINDING:
            yield f"inequalities that bind differ by {unequal:.1e} of beta"
        if not solution.mu.lower * (1.0 - BINDING) <= beta <= solution.mu.upper * (1.0 + ABOVE):
            yield f"they bind at {beta:.6g}, where mu is in {solution.mu}"


def _contact_errors(
    solution: GraspSolution, grasp: Grasp, kkt: KKT, surface: NumericBody, size: float
) -> Iterator[str]:
    """Yield the free contacts whose moves would raise the weighted ratios."""
    weights = np.array(kkt.weights)
    least = SLOPE * solution.mu.upper
    for i in range(len(grasp)):
        normal = _normal_near(solution, grasp, surface, i, size)
        if normal is None or _is_held(solution, i):
            continue
        for tangent in grasp.frames[i][:, 1:].T:
            there, back = (
                float(weights @ _recomputed_ratios(solution, _displace_contact(grasp, i, h * tangent, normal), kkt))
                for h in (STEP * size, -STEP * size)
            )
            slope = (there - back) / (2.0 * STEP)
            if not abs(slope) <= least:
                yield f"contact {i} is free, and moved along its face it changes mu by {slope:.2g} over the body's size"
                break


def _recomputed_ratios(solution: GraspSolution, grasp: Grasp, kkt: KKT) -> FloatArray:
    """Return the support ratios along the directions, (m,)."""
    y = np.array(kkt.directions)
    return np.asarray(WrenchSet.of(grasp, solution.budget).support(y)[0] / solution.task.support(y)[0])


def _displace_contact(grasp: Grasp, i: int, step: FloatArray, normal: Callable[[FloatArray], FloatArray]) -> Grasp:
    """Return the grasp with one contact moved, and the inward normal at its new point."""
    points, normals = grasp.points.copy(), grasp.normals.copy()
    points[i] += step
    normals[i] = normal(points[i])
    return Grasp(points, normals, grasp.contacts, grasp.torque_origin)


def _is_held(solution: GraspSolution, i: int) -> bool:
    """Return whether a contact belongs to a hand with joints or to an active constraint."""
    hand = solution.problem["hand"]
    if hand is not None and hand["type"] not in ("fingertips", "parallel_jaw"):
        return True
    return any(row.active and (not row.fingers or i in row.fingers) for row in solution.constraints)


def _normal_near(
    solution: GraspSolution, grasp: Grasp, surface: NumericBody, i: int, size: float
) -> Callable[[FloatArray], FloatArray] | None:
    """Return the inward normal function near a contact; None at an edge or on an unknown surface."""
    face, point = solution.faces[i], grasp.points[i]
    if isinstance(surface, MeshSurface):
        which, off = surface.triangles.near(point, FREE * size)
        beside = surface.triangles.normals[which[off <= FREE * size]]
        flat = len(beside) > 0 and bool(np.all(np.linalg.norm(beside + grasp.normals[i], axis=1) < FREE))
        near_margin = surface.edge_distance(face, point) <= float(solution.problem["edge_margin"]) + FREE * size
        return None if not flat or near_margin else lambda p: grasp.normals[i]
    if isinstance(surface, SmoothSurface):
        return lambda p: -_unit_vector(surface.field(p[None])[1][0])
    if isinstance(surface, FacedSurface):
        past = surface.pieces[face](point)[2]
        margin = float(solution.problem.get("edge_margin", 0.0))
        at_edge = past >= -FREE * size or surface.edge_distance(face, point) <= margin + FREE * size
        return None if at_edge else lambda p: -_unit_vector(surface.pieces[face](p)[1])
    return None


def _unit_vector(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
