"""Projection of candidates onto the constraints, and of contacts and fingertips onto the triangles of a mesh.

Newton steps of least length move contacts and hand until the constraints hold (``project_onto_constraints``). On a mesh
the faces of the compiled problem are the triangles under the contacts (``fix_to_triangles``).

A flat pad touches a mesh in an edge or a corner, where its normal is not that of a triangle. Such a hand is moved from
the smooth surface into contact with the mesh (``move_to_contact``) by steps of least length, until every fingertip
touches. A round tip with centre c and radius r touches where the nearest point p of the mesh is at distance r, and its
normal is ``(p - c) / r``; other contacts keep the normals of the smooth surface. Links keep their distance from the
mesh, not from the solver's spline of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.mesh.facets import Facets, SmoothPatches
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
from nlpgrasp.optimize.cutting_planes import parameters_without_cuts
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, surface_differences
from nlpgrasp.quality.grasp import Grasp

LONGEST = 0.4  # longest step of contacts and hand onto the constraints, solver units
# rules of these steps; the slack is the weight of the squared violations against the squared step
RULES = NewtonRules(steps=25, enough=0.1 * FEASIBLE, patience=6, slack=ConstraintSlack(1e4))
TOUCHING = 1e-4  # violation, relative to the constraints' scales, that counts as none
STEPS = 12  # Newton steps of a hand towards the nearest mesh points, at most
TIP_TOUCHING = 1e-6  # metres between tip and mesh at which these steps end
LONGEST_HAND_STEP = 0.3  # longest of these steps, solver units
PATCH_STEPS = 3  # Newton steps onto a mesh's smoothed surface
OVERLAP = 0.2  # share of a tip's radius: nearer to the tip's centre the mesh has no usable normal


def project_onto_constraints(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[GraspCandidate, float]:
    """Return a candidate projected onto the constraints, and the remaining violation, relative to their scales."""
    functions = compiled.cutting_planes.functions
    program, theta = functions.program, parameters_without_cuts(compiled, candidate)
    constraints = slice(program.contained, None)
    low, high = (limits[constraints] for limits in program.limits)

    def linearised(z: FloatArray) -> Linearised:
        g, J = functions.linearise(z, theta)
        return Linearised(g[constraints], J[constraints], low, high, *step_bounds(z, program.bounds, LONGEST))

    solution = restore_feasibility(linearised, pack_variables(compiled, program, candidate), RULES)
    return candidate_of(compiled, program, candidate.faces, solution.best), solution.violation


def project_onto_body(
    compiled: CompiledProblem, candidate: GraspCandidate
) -> tuple[CompiledProblem, GraspCandidate, float]:
    """Return a candidate projected onto body and constraints, with the compiled problem and remaining violation.

    On a mesh the compiled problem's faces are the triangles under the contacts; where flat fingertips cannot lie on
    triangles, its face is the smooth surface.
    """
    on_faces, snapped = fix_to_triangles(compiled, candidate)
    moved, violation = project_onto_constraints(on_faces, snapped)
    if violation > TOUCHING and on_faces is not compiled and compiled.hand_functions.has_flat_tips:
        on_faces, faces = compiled, compiled.problem.body.face_names * len(candidate.points)
        moved, violation = project_onto_constraints(
            on_faces, on_faces.projected_onto_faces(replace(candidate, faces=faces))
        )
    return on_faces, on_faces.projected_onto_faces(moved), violation


def fix_to_faces(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem with the body's own faces, on a mesh triangles, and the candidate moved onto them."""
    body = compiled.problem.body
    if isinstance(body, Mesh):
        return fix_to_triangles(compiled, replace(candidate, points=body.closest(candidate.points)[0]))
    return compiled, compiled.projected_onto_faces(candidate)


def fix_to_triangles(
    compiled: CompiledProblem, candidate: GraspCandidate, places: Sequence[FloatArray] = ()
) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem whose faces are the mesh triangles under the contacts, and the candidate on them.

    On other bodies both are unchanged.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
        The faces may name the contacts' triangles.
    places : sequence of (k, 3) arrays
        Points around which contacts stay away from sharp edges, metres; the contacts themselves if not given.
    """
    problem, body = compiled.problem, compiled.problem.body
    if not isinstance(body, Mesh):
        return compiled, candidate
    triangles = body.triangles_at(candidate.points)
    for i, face in enumerate(candidate.faces):
        if face not in body.face_names:  # on an edge two triangles are as near
            triangles[i] = Facets.triangle_of(face)
    facets = Facets(body, triangles, np.stack([candidate.points] if not len(places) else places), problem.margin)
    models = tuple(replace(model, faces=(name,)) for model, name in zip(problem.models, facets.names, strict=True))
    fixed = problem.unchecked(body=facets, contacts=models)
    return compiled.with_faces(fixed), replace(candidate, faces=facets.names)


def fix_to_patches(
    compiled: CompiledProblem, candidate: GraspCandidate, reach: float = 0.1
) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem whose faces are patches of a mesh's smoothed surface at the contacts.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem with a mesh.
    candidate : GraspCandidate
    reach : float
        Distance to which the patches extend, over the body's size.
    """
    problem, points = compiled.problem, candidate.points
    for _ in range(PATCH_STEPS):
        values, slopes, bends = compiled.distance_grid.smooth_distance(points)
        points = points - (values / np.sum(slopes**2, axis=1))[:, None] * slopes
    lengths = np.linalg.norm(slopes, axis=1, keepdims=True)
    patches = SmoothPatches(points, slopes / lengths, bends / lengths[..., None], reach * problem.body.size)
    facets = Facets(compiled.surface.mesh, np.arange(len(points)), points[None], problem.margin, patches)
    models = tuple(replace(model, faces=(name,)) for model, name in zip(problem.models, facets.names, strict=True))
    on_patches = compiled.with_faces(problem.unchecked(body=facets, contacts=models))
    return on_patches, replace(candidate, faces=facets.names, points=points)


def put_on_body(
    compiled: CompiledProblem,
    on_faces: CompiledProblem,
    candidate: GraspCandidate,
    smooth_points: FloatArray | None = None,
) -> GraspOnBody:
    """Return the grasp on the body's actual surface for a candidate on the faces of a compiled problem.

    ``project_onto_body`` moves a candidate onto these faces.

    Parameters
    ----------
    compiled : CompiledProblem
    on_faces : CompiledProblem
        On a mesh the compiled problem whose faces are the triangles under the contacts; ``compiled`` on other bodies
        and where flat fingertips touch edges and corners of a mesh.
    candidate : GraspCandidate
        On the faces of ``on_faces``.
    smooth_points : (k, 3) array, optional
        The contacts on the smooth surface of a mesh, metres; those of the candidate if not given.
    """
    body = compiled.problem.body
    if not isinstance(body, Mesh):
        return GraspOnBody.of(compiled, candidate, compiled.grasp(candidate))
    placed = GraspCandidate(body.face_names * len(candidate.points), candidate.points, candidate.hand)
    grasp = on_faces.grasp(candidate)
    if on_faces is compiled:
        placed, grasp = move_to_contact(compiled, placed)
    start = candidate.points if smooth_points is None else smooth_points
    match = surface_differences(body, start, grasp, compiled.inward_normals(placed), compiled.follows_contacts)
    return GraspOnBody.of(compiled, placed, grasp, match)


def move_to_contact(compiled: CompiledProblem, smooth: GraspCandidate) -> tuple[GraspCandidate, Grasp]:
    """Return a hand moved from a mesh's smooth surface into contact with the mesh itself, and its grasp."""
    touch = _TouchConstraints(compiled, smooth)
    final = restore_feasibility(
        touch.nearest, touch.z[touch.free], NewtonRules(STEPS, TIP_TOUCHING / compiled.scaling.length)
    ).rows
    return GraspCandidate(smooth.faces, final.contacts, final.hand), compiled.grasp_at(final.contacts, final.normals)


class _TouchConstraints:
    """Linearisation of the constraints in the hand's variables, for Newton steps towards contact."""

    def __init__(self, compiled: CompiledProblem, start: GraspCandidate) -> None:
        self.compiled, self.program = compiled, compiled.cutting_planes.functions.program
        self.theta = parameters_without_cuts(compiled, start)
        self.z = pack_variables(compiled, self.program, start)
        self.smooth = compiled.inward_normals(start)
        self.free = np.concatenate([np.arange(b.start, b.stop) for _, b in self.program.hand_blocks])

    def nearest(self, free: FloatArray) -> _TouchLinearisation:
        """Return the constraints linearised with contacts at the mesh points nearest to the fingertips.

        Tips that are not round keep the smooth surface's normal, along which they touch.
        """
        compiled = self.compiled
        radii = np.asarray(compiled.hand_functions.hand.tip_radii)
        centres = compiled.hand_functions.tip_centres(self._hand(free), contact_points(compiled, self.program, self.z))
        contacts, _, distance = compiled.surface.mesh.closest(centres)
        towards = contacts - centres
        outside = np.sum(towards * self.smooth, axis=1) > 0.0
        round_tip = (radii > 0.0) & (distance > OVERLAP * radii) & outside
        inward = np.where(round_tip[:, None], towards / np.maximum(distance, 1e-12)[:, None], self.smooth)
        return self.linearise(free, contacts, inward)

    def linearise(self, free: FloatArray, contacts: FloatArray, normals: FloatArray) -> _TouchLinearisation:
        """Return the constraints linearised at given values of the hand's variables and given contacts."""
        compiled, program, hand = self.compiled, self.program, self._hand(free)
        set_contacts(compiled, program, self.z, contacts, normals)
        g, J = compiled.cutting_planes.functions.linearise(self.z, self.theta)
        placement = program.placement
        low, high = (limits[placement] for limits in program.limits)
        bounds = step_bounds(free, (program.bounds[0][self.free], program.bounds[1][self.free]), LONGEST_HAND_STEP)
        return _TouchLinearisation(
            g[placement], J[placement][:, self.free], low, high, *bounds, contacts, normals, hand
        )

    def _hand(self, free: FloatArray) -> Values:
        """Write the hand's free variables into z, and return the hand's configuration."""
        self.z[self.free] = free
        return hand_of(self.program, self.z)


@dataclass(frozen=True)
class _TouchLinearisation(Linearised):
    """Linearised constraints of a touching hand, with its contacts and configuration."""

    contacts: FloatArray
    normals: FloatArray
    hand: Values
