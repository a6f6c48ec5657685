"""Grasp on the body itself, with its constraint values, violation and per-contact constraints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.scalar_constraints import EDGE_MARGIN, ROOM, Label
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.problem.candidate_constraints import FITS
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.placed_grasp import OWN_NORMAL, SurfaceMatch
from nlpgrasp.solution.records import ConstraintReport

ACTIVE = 1e-4  # relative to a constraint's scale: distance from a limit at which it counts as active


@dataclass(frozen=True)
class GraspOnBody:
    """Grasp on the body itself, with the body's own normals and its constraint values.

    Parameters
    ----------
    candidate : GraspCandidate
        Contacts and hand.
    grasp : Grasp
        The same contacts with the body's own normals.
    values : (rows,) array
        Of the rows of constraints and hand, in their own units; distances from a mesh are the mesh's own.
    violation : float
        Largest violation of these rows, relative to their scales, and of those beside, over the body's size.
    surface : SurfaceMatch or None
        For meshes.
    beside : tuple of LowerLimit
        What is asked of each contact by itself: the margin from sharp edges, on a mesh room for its fingertip.
    """

    candidate: GraspCandidate
    grasp: Grasp
    values: FloatArray
    violation: float
    surface: SurfaceMatch | None = None
    beside: tuple[LowerLimit, ...] = ()

    @classmethod
    def of(
        cls, compiled: CompiledProblem, candidate: GraspCandidate, grasp: Grasp, surface: SurfaceMatch | None = None
    ) -> GraspOnBody:
        """Return a grasp with its constraint values and largest violation."""
        values = compiled.row_values(candidate, grasp.normals)
        own = tuple(contact_constraints(compiled.problem, candidate, grasp.normals))
        short = max((row.lower - row.value for row in own), default=0.0) / compiled.problem.body.size
        return cls(candidate, grasp, values, max(float(compiled.rows.excess(values[None])[0]), short), surface, own)

    @property
    def is_feasible(self) -> bool:
        """Whether the grasp is feasible; on a mesh to ten times the tolerance, at which its steps end."""
        return self.violation <= (FEASIBLE if self.surface is None else 10.0 * FEASIBLE)


def constraint_reports(
    compiled: CompiledProblem, found: GraspOnBody, multipliers: FloatArray
) -> tuple[ConstraintReport, ...]:
    """Return value, limits, multiplier and activity of every scalar constraint.

    The solver's multiplier is the derivative of the minimised ``-beta`` with respect to the row; a limit moved by
    one unit of the row changes mu by that over the task's and the row's scales.
    """
    reports = []
    for row, value, multiplier in zip(compiled.rows.named, found.values, multipliers, strict=True):
        distance = min(value - row.lower, row.upper - value)
        active = bool(distance <= ACTIVE * row.scale)
        price = float(multiplier) / (compiled.scaling.beta * row.scale) if active else 0.0
        limits = row.lower, row.upper
        reports.append(ConstraintReport(row.name, float(value), *limits, price, active, row.kind, row.fingers))
    for beside in found.beside:  # what they cost is among the prices
        label, limits = beside.label, (beside.lower, np.inf)
        active = bool(beside.value - beside.lower <= ACTIVE * compiled.problem.body.size)
        reports.append(ConstraintReport(label.name, beside.value, *limits, 0.0, active, label.kind, label.fingers))
    return tuple(reports)


def match_on_mesh(body: Mesh, start: FloatArray, grasp: Grasp, smooth: FloatArray, free: bool) -> SurfaceMatch:
    """Return the differences between contacts on the smooth surface and the grasp on the mesh.

    Parameters
    ----------
    body : Mesh
    start : (k, 3) array
        Contacts on the smooth surface, metres.
    grasp : Grasp
        On the mesh, with the inward normals that are stated.
    smooth : (k, 3) array
        Inward unit normals of the smooth surface at the grasp's contacts.
    free : bool
        Whether no posed fingertips touch: contacts then have the normal of one triangle, also on edges.
    """
    stated = body.angles_off_normals(grasp.points, -grasp.normals, on_edges=not free)
    own = np.where((stated <= OWN_NORMAL)[:, None], grasp.normals, -body.closest(grasp.points)[1])
    angles = np.arccos(np.clip(np.sum(smooth * own, axis=1), -1.0, 1.0))
    moved = np.linalg.norm(grasp.points - start, axis=1)
    return SurfaceMatch(body.closest(start)[2], angles, moved, stated)


@dataclass(frozen=True)
class LowerLimit:
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


def contact_constraints(problem: GraspProblem, candidate: GraspCandidate, normals: FloatArray) -> Iterator[LowerLimit]:
    """Yield the distances of contacts with inward normals (k, space) from sharp edges, and of tip centres from a mesh.

    Nothing is said of a face without sharp edges, of a fingertip that is a point or belongs to a hand with a pose, and
    of the room on bodies whose distance is an expression: rows of the program say it.
    """
    for i, value in enumerate(edge_distances(problem, candidate)):
        if np.isfinite(value):
            yield LowerLimit(Label(EDGE_MARGIN, fingers=(i,)), float(value), problem.margin)
    body, hand = problem.body, problem.hand
    if isinstance(body, Mesh) and hand is not None and hand.follows_contacts:
        for i, radius in enumerate(hand.tip_radii):
            if radius > 0.0:
                centre = candidate.points[i] - radius * normals[i]
                yield LowerLimit(Label(ROOM, fingers=(i,)), float(body.clearance(centre[None])[0]), FITS * radius)


def edge_distances(problem: GraspProblem, candidate: GraspCandidate) -> FloatArray:
    """Return the distance of each contact from its face's sharp edges, (k,), metres; inf where there are none."""
    apart, faces = np.empty(len(candidate.points)), np.array(candidate.faces)
    for face in set(candidate.faces):
        on = faces == face
        apart[on] = problem.body.edge_distance(face, candidate.points[on])
    return apart


def edge_margin_violation(problem: GraspProblem, candidate: GraspCandidate) -> FloatArray:
    """Return each contact's violation of the margin from sharp edges, (k,), over the body's size."""
    if problem.margin == 0.0:
        return np.zeros(len(candidate.points))
    return np.asarray(np.maximum((problem.margin - edge_distances(problem, candidate)) / problem.body.size, 0.0))
