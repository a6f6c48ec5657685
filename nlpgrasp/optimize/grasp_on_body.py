"""Grasp on the actual surface of the body (not the smoothed one), with its constraint values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.scalar_constraints import CLEARANCE, EDGE_MARGIN, FINGERTIP_CLEARANCE, Label
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Table
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.problem.candidate_constraints import FITS
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.obstructions import TABLE
from nlpgrasp.solution.placed_grasp import OWN_NORMAL, SurfaceMatch
from nlpgrasp.solution.records import ConstraintReport

ACTIVE = 1e-4  # over a constraint's scale: distance from a limit below which it is active


@dataclass(frozen=True)
class GraspOnBody:
    """Grasp on the actual surface of the body, with that surface's normals and the constraint values.

    Parameters
    ----------
    candidate : GraspCandidate
        Contacts and hand.
    grasp : Grasp
        The same contacts with the body's own normals.
    values : (rows,) array
        Values of the constraints, in their own units; distances from a mesh are from the mesh itself.
    violation : float
        Largest violation of these, relative to their scales, and of the lengths, over the body's size.
    surface : SurfaceMatch or None
        Differences from the smoothed surface, for meshes.
    lengths : tuple of LimitedLength
        Constraints of single contacts: margin from sharp edges, and on a mesh clearance of the fingertip; and those of
        links: their clearances where some are required.
    """

    candidate: GraspCandidate
    grasp: Grasp
    values: FloatArray
    violation: float
    surface: SurfaceMatch | None = None
    lengths: tuple[LimitedLength, ...] = ()

    @classmethod
    def of(
        cls, compiled: CompiledProblem, candidate: GraspCandidate, grasp: Grasp, surface: SurfaceMatch | None = None
    ) -> GraspOnBody:
        """Return a grasp with its constraint values and largest violation."""
        values = compiled.constraint_values_at(candidate, grasp.normals)
        limits = (
            *contact_constraints(compiled.problem, candidate, grasp.normals),
            *_link_clearances(compiled, candidate),
        )
        excess = max((limit.lower - limit.value for limit in limits), default=0.0) / compiled.problem.body.size
        violation = max(float(compiled.rows.largest_violations(values[None])[0]), excess)
        return cls(candidate, grasp, values, violation, surface, limits)

    @property
    def is_feasible(self) -> bool:
        """Whether all constraints hold; on a mesh to ten times the tolerance."""
        return self.violation <= (FEASIBLE if self.surface is None else 10.0 * FEASIBLE)


def constraint_reports(
    compiled: CompiledProblem, on_body: GraspOnBody, multipliers: FloatArray
) -> tuple[ConstraintReport, ...]:
    """Return a report of each of the problem's scalar constraints: value, limits, multiplier, and whether it is active.

    The solver's multiplier is the derivative of the minimised ``-beta`` with respect to the scaled constraint; over the
    scales of task and constraint, it is the derivative of mu with respect to the limit in the constraint's unit.
    """
    reports = []
    for constraint, value, multiplier in zip(compiled.rows.named, on_body.values, multipliers, strict=True):
        distance = min(value - constraint.lower, constraint.upper - value)
        active = bool(distance <= ACTIVE * constraint.scale)
        price = float(multiplier) / (compiled.scaling.beta * constraint.scale) if active else 0.0
        name, kind, bounds = constraint.name, constraint.kind, (constraint.lower, constraint.upper)
        reports.append(ConstraintReport(name, float(value), *bounds, price, active, kind, constraint.fingers))
    for limit in on_body.lengths:  # their multipliers are computed with the shadow prices
        label, bounds = limit.label, (limit.lower, np.inf)
        active = bool(limit.value - limit.lower <= ACTIVE * compiled.problem.body.size)
        reports.append(ConstraintReport(label.name, limit.value, *bounds, 0.0, active, label.kind, label.fingers))
    return tuple(reports)


def surface_differences(body: Mesh, start: FloatArray, grasp: Grasp, smooth: FloatArray, free: bool) -> SurfaceMatch:
    """Return the differences between contacts on the smoothed surface and the grasp on the mesh.

    Parameters
    ----------
    body : Mesh
    start : (k, 3) array
        Contacts on the smoothed surface, metres.
    grasp : Grasp
        Grasp on the mesh, with the inward normals stated in the result.
    smooth : (k, 3) array
        Inward unit normals of the smoothed surface at the grasp's contacts.
    free : bool
        Whether there is no hand with a pose: contacts then have the normal of one triangle, also on edges.
    """
    deviations = body.angles_off_normals(grasp.points, -grasp.normals, on_edges=not free)
    # on an edge the mesh has many normals: the grasp's is the one to compare with if it is among them
    mesh_normals = np.where((deviations <= OWN_NORMAL)[:, None], grasp.normals, -body.closest(grasp.points)[1])
    angles = np.arccos(np.clip(np.sum(smooth * mesh_normals, axis=1), -1.0, 1.0))
    moved = np.linalg.norm(grasp.points - start, axis=1)
    return SurfaceMatch(distances=body.closest(start)[2], angles=angles, moved=moved, stated=deviations)


@dataclass(frozen=True)
class LimitedLength:
    """Length with a lower limit.

    Parameters
    ----------
    label : Label
    value, lower : float
        Metres.
    """

    label: Label
    value: float
    lower: float


def contact_constraints(
    problem: GraspProblem, candidate: GraspCandidate, normals: FloatArray
) -> Iterator[LimitedLength]:
    """Yield the constraints of single contacts: distance from sharp edges, fingertip clearance from a mesh.

    Inward normals are (k, space).

    Faces without sharp edges and point fingertips have none. The clearance of fingertips of a hand with a pose, and on
    bodies other than meshes, is among the constraints of the program.
    """
    for i, value in enumerate(edge_distances(problem, candidate)):
        if np.isfinite(value):
            yield LimitedLength(Label(EDGE_MARGIN, fingers=(i,)), float(value), problem.margin)
    body, hand = problem.body, problem.hand
    if isinstance(body, Mesh) and hand is not None and hand.follows_contacts:
        for i, radius in enumerate(hand.tip_radii):
            if radius > 0.0:
                centre = candidate.points[i] - radius * normals[i]
                yield LimitedLength(
                    Label(FINGERTIP_CLEARANCE, fingers=(i,)), float(body.clearance(centre[None])[0]), FITS * radius
                )


def _link_clearances(compiled: CompiledProblem, candidate: GraspCandidate) -> Iterator[LimitedLength]:
    """Yield the distance of each link from what it has to keep a clearance from, by its shapes, up to 50 mm."""
    for number, link, distance, least in compiled.required_clearances(candidate):
        solid = CLEARANCE
        if number and compiled.collision_model is not None:
            solid = compiled.collision_model.fields[number].solid
        yield LimitedLength(Label(Table.kind if solid == TABLE else solid, link=link), distance, least)


def edge_distances(problem: GraspProblem, candidate: GraspCandidate) -> FloatArray:
    """Return the distance of each contact from its face's sharp edges, (k,), metres; inf without sharp edges."""
    distances, faces = np.empty(len(candidate.points)), np.array(candidate.faces)
    for face in set(candidate.faces):
        on_face = faces == face
        distances[on_face] = problem.body.edge_distance(face, candidate.points[on_face])
    return distances


def edge_margin_violation(problem: GraspProblem, candidate: GraspCandidate) -> FloatArray:
    """Return each contact's violation of the margin from sharp edges, relative to the body's size, (k,)."""
    if problem.margin == 0.0:
        return np.zeros(len(candidate.points))
    return np.asarray(np.maximum((problem.margin - edge_distances(problem, candidate)) / problem.body.size, 0.0))
