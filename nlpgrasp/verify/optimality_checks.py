"""Checks of optima: binding inequalities and first-order gains of a local one, and how bad a worst displacement is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.force_problem import finger_forces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks.task_set import MISSING, is_sampled
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.numeric_bodies import FacedSurface, SmoothSurface
from nlpgrasp.verify.proved_bounds import support_ratio
from nlpgrasp.verify.stated_placement import NumericBody

SUM_TOLERANCE = 1e-5  # tolerance of the sum of the weights
BINDING_TOLERANCE = 1e-5  # largest spread of binding inequalities, relative to beta
BETA_EXCESS = 2e-3  # largest relative excess of the program's beta over mu
SLOPE_TOLERANCE = 1e-4  # share of mu: largest first-order gain of a free contact over the body's size
DIFFERENCE_STEP = 1e-6  # share of the body's size: step of central differences
EDGE_DISTANCE = 1e-3  # share of the body's size: least distance of a free contact from edges
RING_ANGLES = np.pi / 4.0 * np.arange(8)  # of displacements of a contact
SEARCHES, LOOSE_RTOL = 3, 0.1  # searches for a worse displacement; relative gap of the certificates in them
MILDER = 0.8  # share of the stated quality: a displacement that leaves less is worse than the worst that was found


def optimality_checks(solution: GraspSolution, grasp: Grasp, surface: NumericBody | None, size: float) -> list[Check]:
    """Return the check of a stored local optimum; an empty list without one.

    The stored inequalities have to bind equally at mu, and no move of a free contact may raise mu to first order.
    Contacts of a hand with joints, and those in active constraints, are not free and not checked.
    """
    kkt = solution.kkt
    if kkt is None:
        return []
    if is_sampled(solution.task):
        return [Check.not_made("local optimum", MISSING)]
    errors = [*_weight_errors(solution, grasp, kkt)]
    if not errors and kkt.is_small and surface is not None:
        errors += [*_contact_errors(solution, grasp, kkt, surface, size)]
    return [Check.of_errors("local optimum", errors, kkt.words)]


def _weight_errors(solution: GraspSolution, grasp: Grasp, kkt: KKT) -> Iterator[str]:
    """Yield errors in the directions and weights of the binding inequalities."""
    weights = np.array(kkt.weights)
    if len(kkt.directions) != len(weights) or any(len(y) != grasp.dimension for y in kkt.directions):
        yield f"{len(kkt.directions)} directions of dimension {grasp.dimension} for {len(weights)} weights"
    elif kkt.is_small and not len(weights):
        yield "a local optimum along no direction"
    elif len(weights) and (np.min(weights) < 0.0 or abs(np.sum(weights) - 1.0) > SUM_TOLERANCE):
        yield f"weights from {np.min(weights):.3g} with a sum of {np.sum(weights):.9g}"
    elif kkt.is_small:
        ratios = _recomputed_ratios(solution, grasp, kkt)
        beta = float(weights @ ratios)
        spread = float(np.max(weights * np.abs(ratios - beta))) / beta
        if not spread <= BINDING_TOLERANCE:
            yield f"inequalities that bind differ by {spread:.1e} of beta"
        if not solution.mu.lower * (1.0 - BINDING_TOLERANCE) <= beta <= solution.mu.upper * (1.0 + BETA_EXCESS):
            yield f"they bind at {beta:.6g}, where mu is in {solution.mu}"


def _contact_errors(
    solution: GraspSolution, grasp: Grasp, kkt: KKT, surface: NumericBody, size: float
) -> Iterator[str]:
    """Yield an error for each free contact that would change mu to first order by moving along its face."""
    if solution.surface is not None and np.any(solution.surface.angles > EDGE_DISTANCE):
        return  # an optimum on the solver's smooth surface, whose normals differ there from the mesh's
    weights, forces = np.array(kkt.weights), _tight_forces(solution, grasp, kkt)

    def work(moved: Grasp) -> float:
        """Return the mean of the ratios; with given forces where the support has a kink."""
        if forces is None:
            return float(weights @ _recomputed_ratios(solution, moved, kkt))
        y = np.array(kkt.directions)
        return float(weights @ (np.sum((y @ moved.G) * forces, axis=1) / solution.task.support(y)[0]))

    tolerance = SLOPE_TOLERANCE * solution.mu.upper
    for i in range(len(grasp)):
        normal = _normal_near(solution, grasp, surface, i, size)
        if normal is None or _is_held(solution, i):
            continue
        for tangent in grasp.frames[i][:, 1:].T:
            forward, backward = (
                work(_displace_contact(grasp, i, step * tangent, normal))
                for step in (DIFFERENCE_STEP * size, -DIFFERENCE_STEP * size)
            )
            slope = (forward - backward) / (2.0 * DIFFERENCE_STEP)
            if not abs(slope) <= tolerance:
                yield f"contact {i} is free, and moved along its face it changes mu by {slope:.2g} over the body's size"
                break


def displacement_checks(solution: GraspSolution, grasp: Grasp, surface: NumericBody | None, size: float) -> list[Check]:
    """Return the check that no other displacement of the contacts leaves far less than the stated worst one.

    Contacts move one after the other, in the plane of their face, to where the support ratio along the weakest
    directions found so far is least. Contacts at edges, on curved meshes and such that slip stay as stated.
    """
    robust = solution.robust
    if robust is None or surface is None or is_sampled(solution.task) or not robust.mu.lower > 0.0:
        return []
    if len(robust.points) != len(grasp):  # which the check of robustness sees
        return []
    remaining = [i for i in range(len(grasp)) if i not in robust.lost]
    models = [grasp.contacts[i].with_friction(1.0 - robust.friction_share) for i in remaining]
    places = [[(robust.points[i], robust.normals[i]), *_ring(solution, grasp, surface, i, size)] for i in remaining]
    chosen, directions, least = [0] * len(remaining), list[FloatArray](), np.inf

    def displaced(choice: Sequence[int]) -> Grasp:
        points, normals = zip(*(around[c] for around, c in zip(places, choice, strict=True)), strict=True)
        return Grasp(np.array(points), np.array(normals), models, grasp.torque_origin)

    def ratio(choice: Sequence[int]) -> float:
        at = displaced(choice)
        force_set = solution.budget.at(at.frames, at.contacts)
        return min(support_ratio(at, solution.task, force_set, y) for y in directions)

    for _ in range(SEARCHES):
        bounds = mu(displaced(chosen), solution.task, LOOSE_RTOL, force_budget=solution.budget)
        least = min(least, bounds.upper)
        if bounds.worst_direction is None or not bounds.upper > 0.0:
            break
        directions.append(bounds.worst_direction)
        for i, around in enumerate(places):
            chosen = min(([*chosen[:i], c, *chosen[i + 1 :]] for c in range(len(around))), key=ratio)
    least = min(least, ratio(chosen)) if directions else least
    text = f"at most {least:.4g} left at another displacement, at least {robust.mu.lower:.4g} stated at the worst"
    return [Check("worst displacement", least >= MILDER * robust.mu.lower, text)]


def _ring(
    solution: GraspSolution, grasp: Grasp, surface: NumericBody, i: int, size: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return points at the stated displacement around a contact, with inward normals; none where these are unknown."""
    robust = solution.robust
    normal = None if robust is None else _normal_near(solution, grasp, surface, i, size, room=robust.offset)
    if normal is None or robust is None:
        return []
    across = grasp.frames[i][:, 1:].T
    weights = np.column_stack([np.cos(RING_ANGLES), np.sin(RING_ANGLES)]) if len(across) == 2 else [[1.0], [-1.0]]
    points = [grasp.points[i] + robust.offset * (np.asarray(w) @ across) for w in weights]
    return [(p, normal(p)) for p in points]


def _recomputed_ratios(solution: GraspSolution, grasp: Grasp, kkt: KKT) -> FloatArray:
    """Return the ratio of wrench-set support to task support along each direction, (m,)."""
    y = np.array(kkt.directions)
    return np.asarray(WrenchSet.of(grasp, solution.budget).support(y)[0] / solution.task.support(y)[0])


def _tight_forces(solution: GraspSolution, grasp: Grasp, kkt: KKT) -> FloatArray | None:
    """Return forces (m, n) that exert what the task asks for along each direction; None where maximisers are unique.

    Under budgets whose support has kinks several forces do the most work along a weakest direction. mu changes as the
    work of those does that exert the tight wrench: the task's maximiser times the ratio.
    """
    budget, y = solution.budget, np.array(kkt.directions)
    if not budget.has_kinks:
        return None
    wrenches = solution.task.support(y)[1] * _recomputed_ratios(solution, grasp, kkt)[:, None]
    exerted = finger_forces(grasp, wrenches, force_budget=budget)
    is_tight = exerted.feasible & (np.abs(exerted.used - 1.0) < BINDING_TOLERANCE)
    maximisers = WrenchSet.of(grasp, budget).forces(y)[1]
    return np.where(is_tight[:, None], exerted.forces, maximisers)


def _displace_contact(grasp: Grasp, i: int, step: FloatArray, normal: Callable[[FloatArray], FloatArray]) -> Grasp:
    """Return the grasp with one contact moved and its normal updated."""
    points, normals = grasp.points.copy(), grasp.normals.copy()
    points[i] += step
    normals[i] = normal(points[i])
    return Grasp(points, normals, grasp.contacts, grasp.torque_origin)


def _is_held(solution: GraspSolution, i: int) -> bool:
    """Return whether a contact is not free: on a hand with joints, or in an active constraint."""
    hand = solution.problem["hand"]
    if hand is not None and hand["type"] not in ("fingertips", "parallel_jaw"):
        return True
    return any(
        constraint.active and (not constraint.fingers or i in constraint.fingers) for constraint in solution.constraints
    )


def _normal_near(
    solution: GraspSolution, grasp: Grasp, surface: NumericBody, i: int, size: float, room: float | None = None
) -> Callable[[FloatArray], FloatArray] | None:
    """Return the function from points near a contact to inward normals; None at an edge or on an unknown surface.

    Points are near within ``room``, metres; those of a free contact within less, but off the edge margin.
    """
    face, point, least = solution.faces[i], grasp.points[i], EDGE_DISTANCE * size
    near = least if room is None else max(room, least)
    from_edges = float(solution.problem.get("edge_margin", 0.0)) + least if room is None else room
    if isinstance(surface, MeshSurface):
        nearby, distances = surface.triangles.nearby_triangles(point, near)
        neighbour_normals = surface.triangles.normals[nearby[distances <= near]]
        is_flat = len(neighbour_normals) > 0 and bool(
            np.all(np.linalg.norm(neighbour_normals + grasp.normals[i], axis=1) < EDGE_DISTANCE)
        )
        is_near_edge = surface.edge_distance(face, point) <= from_edges
        return None if not is_flat or is_near_edge else lambda p: grasp.normals[i]
    if isinstance(surface, SmoothSurface):
        return lambda p: -_unit_vector(surface.field(p[None])[1][0])
    if isinstance(surface, FacedSurface):
        overshoot = surface.pieces[face](point)[2]
        is_near_edge = overshoot >= -near or surface.edge_distance(face, point) <= from_edges
        return None if is_near_edge else lambda p: -_unit_vector(surface.pieces[face](p)[1])
    return None


def _unit_vector(vector: FloatArray) -> FloatArray:
    """Return a vector scaled to length 1."""
    return np.asarray(vector / np.linalg.norm(vector))
