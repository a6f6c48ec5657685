"""Projection of candidates onto the constraints, and of contacts and fingertips onto the triangles of a mesh.

Newton steps move contacts and hand as little as they can until the constraints hold (``project_onto_constraints``). On
a mesh the faces of the compiled problem are the triangles under the contacts (``fix_to_triangles``).

A flat pad touches a mesh in an edge or a corner, where its normal is none of a triangle's. Such a hand is moved from
the smooth surface into contact with the mesh (``move_to_contact``), as little as it can, until every fingertip touches.
A round tip with centre c and radius r touches where the nearest point p of the mesh is at distance r, and its normal is
``(p - c) / r``; other contacts keep the normals of the smooth surface. Links keep their distance from the mesh, not
from the solver's spline of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.mesh.facets import Facets
from nlpgrasp.common.quadratic_program import ConstraintSlack, Linearised, NewtonRules, restore_feasibility, step_bounds
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import (
    FEASIBLE,
    CompiledProblem,
    candidate_of,
    contact_points,
    hand_of,
    pack_variables,
    set_contacts,
)
from nlpgrasp.optimize.cutting_planes import empty_slots
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, match_on_mesh
from nlpgrasp.quality.grasp import Grasp

LONGEST = 0.4  # longest step of contacts and hand onto the constraints, solver units
# of these steps; RowSlack: weight of the squared violations against the squared step
RULES = NewtonRules(steps=25, enough=0.1 * FEASIBLE, patience=6, slack=ConstraintSlack(1e4))
TOUCHING = 1e-4  # violation, relative to the constraints' scales, that counts as none
STEPS = 12  # Newton steps of a hand towards the nearest mesh points, at most
TIP_TOUCHING = 1e-6  # metres between tip and mesh at which these steps end
LONGEST_HAND_STEP = 0.3  # the longest of them, solver units
OVERLAP = 0.2  # share of a tip's radius: the mesh has no usable normal nearer to its centre


def project_onto_constraints(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[GraspCandidate, float]:
    """Return a candidate projected onto the constraints, and the remaining violation, relative to their scales."""
    functions = compiled.cutting_planes.functions
    program, theta = functions.program, empty_slots(compiled, candidate)
    used = slice(program.contained, None)
    low, high = (limits[used] for limits in program.limits)

    def rows(z: FloatArray) -> Linearised:
        g, J = functions.linearise(z, theta)
        return Linearised(g[used], J[used], low, high, *step_bounds(z, program.bounds, LONGEST))

    found = restore_feasibility(rows, pack_variables(compiled, program, candidate), RULES)
    return candidate_of(compiled, program, candidate.faces, found.best), found.violation


def touching_on_body(
    compiled: CompiledProblem, candidate: GraspCandidate
) -> tuple[CompiledProblem, GraspCandidate, float]:
    """Return a candidate projected onto its constraints, on a mesh on its triangles, and the remaining violation.

    The first part is the compiled problem whose faces its contacts are on. It is that of a mesh's smooth surface where
    flat fingertips cannot lie on triangles.
    """
    own, there = fix_to_triangles(compiled, candidate)
    moved, left = project_onto_constraints(own, there)
    if left > TOUCHING and own is not compiled and compiled.hand_points.has_flat_tips:
        own, faces = compiled, compiled.problem.body.face_names * len(candidate.points)
        moved, left = project_onto_constraints(own, own.snapped(replace(candidate, faces=faces)))
    return own, own.snapped(moved), left


def fix_to_triangles(
    compiled: CompiledProblem, candidate: GraspCandidate, places: Sequence[FloatArray] = ()
) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem whose faces are the mesh triangles under the contacts, and the candidate on them.

    Of another body both are as they are.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
        Contacts may say by their faces which triangles theirs are.
    places : sequence of (k, 3) arrays
        Where contacts stay away from sharp edges, metres; about themselves if not given.
    """
    problem, body = compiled.problem, compiled.problem.body
    if not isinstance(body, Mesh):
        return compiled, candidate
    triangles = body.triangles_at(candidate.points)
    for i, face in enumerate(candidate.faces):
        if face not in body.face_names:  # on an edge two are as near
            triangles[i] = Facets.triangle_of(face)
    facets = Facets(body, triangles, np.stack([candidate.points] if not len(places) else places), problem.margin)
    models = tuple(replace(model, faces=(name,)) for model, name in zip(problem.models, facets.names, strict=True))
    own = problem.unchecked(body=facets, contacts=models)
    return compiled.with_faces(own), replace(candidate, faces=facets.names)


def put_on_body(
    compiled: CompiledProblem, own: CompiledProblem, candidate: GraspCandidate, begun: FloatArray | None = None
) -> GraspOnBody:
    """Return the grasp of the body itself.

    Parameters
    ----------
    compiled : CompiledProblem
    own : CompiledProblem
        ``compiled``, or on a mesh the one whose faces are the triangles that contacts are on; ``compiled`` where flat
        fingertips touch its edges and corners.
    candidate : GraspCandidate
        On the faces of ``own``.
    begun : (k, 3) array, optional
        Where contacts were on the smooth surface of a mesh, metres; where they are if not given.
    """
    body = compiled.problem.body
    if not isinstance(body, Mesh):
        return GraspOnBody.of(compiled, candidate, compiled.grasp(candidate))
    there, grasp = (
        GraspCandidate(body.face_names * len(candidate.points), candidate.points, candidate.hand),
        own.grasp(candidate),
    )
    if own is compiled:
        there, grasp = move_to_contact(compiled, there)
    start = candidate.points if begun is None else begun
    match = match_on_mesh(body, start, grasp, compiled.inward_normals(there), compiled.follows_contacts)
    return GraspOnBody.of(compiled, there, grasp, match)


def move_to_contact(compiled: CompiledProblem, smooth: GraspCandidate) -> tuple[GraspCandidate, Grasp]:
    """Return the hand moved into contact with the mesh, from contacts on the smooth surface, and its grasp."""
    hand = _TouchConstraints(compiled, smooth)
    rows = restore_feasibility(
        hand.nearest, hand.z[hand.free], NewtonRules(STEPS, TIP_TOUCHING / compiled.scaling.length)
    ).rows
    return GraspCandidate(smooth.faces, rows.contacts, rows.hand), compiled.grasp_at(rows.contacts, rows.normals)


class _TouchConstraints:
    """Linearisation of the constraints in the hand's variables, for Newton steps towards contact."""

    def __init__(self, compiled: CompiledProblem, start: GraspCandidate) -> None:
        self.compiled, self.program = compiled, compiled.cutting_planes.functions.program
        self.theta = empty_slots(compiled, start)
        self.z = pack_variables(compiled, self.program, start)
        self.smooth = compiled.inward_normals(start)
        self.free = np.concatenate([np.arange(b.start, b.stop) for _, b in self.program.hand_blocks])

    def nearest(self, free: FloatArray) -> _TouchLinearisation:
        """Return the constraints for contacts at the mesh points nearest to the fingertips.

        Tips that are not round keep the smooth normal: theirs, as they touch along it.
        """
        compiled = self.compiled
        radii = np.asarray(compiled.hand_points.hand.tip_radii)
        centres = compiled.hand_points.tip_centres(self._hand(free), contact_points(compiled, self.program, self.z))
        contacts, _, distance = compiled.surface.mesh.closest(centres)
        towards = contacts - centres
        outside = np.sum(towards * self.smooth, axis=1) > 0.0
        round_tip = (radii > 0.0) & (distance > OVERLAP * radii) & outside
        inward = np.where(round_tip[:, None], towards / np.maximum(distance, 1e-12)[:, None], self.smooth)
        return self.rows(free, contacts, inward)

    def rows(self, free: FloatArray, contacts: FloatArray, normals: FloatArray) -> _TouchLinearisation:
        """Return the constraints for values of the hand's variables and arbitrary contacts."""
        compiled, program, here = self.compiled, self.program, self._hand(free)
        set_contacts(compiled, program, self.z, contacts, normals)
        g, J = compiled.cutting_planes.functions.linearise(self.z, self.theta)
        used = program.placement
        g = g[used]
        g[compiled.rows.clearances] = (
            compiled.hand_points.mesh_clearances(compiled.surface.mesh, here) / compiled.scaling.length
        )
        low, high = (limits[used] for limits in program.limits)
        bounds = step_bounds(free, (program.bounds[0][self.free], program.bounds[1][self.free]), LONGEST_HAND_STEP)
        return _TouchLinearisation(g, J[used][:, self.free], low, high, *bounds, contacts, normals, here)

    def _hand(self, free: FloatArray) -> Values:
        """Return the hand's variables, and store them."""
        self.z[self.free] = free
        return hand_of(self.program, self.z)


@dataclass(frozen=True)
class _TouchLinearisation(Linearised):
    """Constraints of a touching hand, linearised, with its contacts and configuration."""

    contacts: FloatArray
    normals: FloatArray
    hand: Values
