"""Refinement of candidates on the actual surface of the body, with margins from joint limits.

On a mesh each contact stays on its triangle. With a hand that has a pose, refinement around the smooth surface comes
first, and coordinate exchange of fingers over mesh points alternates with refinement (``refine_on_body``).

Where joints of a hand keep a margin from their limits, their ranges are narrowed by it (``refine_with_margins``).
Joints that cannot keep it while the fingertips touch have their whole range; so have those whose margins cost more of
mu, to first order by their multipliers, than ``SolveOptions.room_price`` allows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.cutting_planes import nearest_to_binding
from nlpgrasp.optimize.finger_exchange import exchange_fingers
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.local_search import LEAST_GAIN, RefinementResult, advance, refine
from nlpgrasp.optimize.projection import (
    TOUCHING,
    fix_to_triangles,
    project_onto_body,
    project_onto_constraints,
    put_on_body,
)
from nlpgrasp.optimize.trust_region import Linearisation

NEARBY = 1e-3  # trust-region radius over the body's size of the linearised program that prices the margins
PASSES = 4  # refinements on triangles while contacts come too near to further sharp edges of a mesh, at most
ROUNDS = 4  # rounds of refinement of a candidate before it is compared with others
COARSE = 2e-3  # relative gain below which a round around the smooth surface is idle: triangles change it by more
EXCHANGES, GAIN = 4, 2e-3  # exchanges of a hand's fingers on a mesh, at most; least relative gain of one


def refine_on_body(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Refine a candidate, and return its grasp on the body's actual surface and the result of the search."""
    body = compiled.problem.body
    if not isinstance(body, Mesh):
        return refine_on_triangles(compiled, compiled.projected_onto_faces(candidate), deadline)
    if compiled.follows_contacts:
        return refine_on_triangles(compiled, replace(candidate, points=body.closest(candidate.points)[0]), deadline)
    faces = body.face_names * len(candidate.faces)
    candidate = _around_smooth_surface(compiled, replace(candidate, faces=faces), deadline)
    on_body, result = refine_on_triangles(compiled, candidate, deadline)
    for _ in range(EXCHANGES):
        value = result.point.value
        if deadline.should_stop() or value <= 0.0 or not compiled.options.rounds:
            break
        moved = exchange_fingers(compiled, on_body.candidate, on_body.grasp.normals, np.random.default_rng(0), deadline)
        if moved is None:
            break
        trial, improved = refine_on_triangles(compiled, moved, deadline)
        if not trial.is_feasible or (on_body.is_feasible and improved.point.value <= (1.0 + GAIN) * value):
            break
        on_body, result = trial, replace(improved, history=result.history + improved.history)
    return on_body, result


def refine_on_triangles(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Refine a candidate with contacts on a mesh fixed to their triangles, and return its grasp and the result.

    Where the smooth distance overestimates the clearance of links from the mesh, the required clearance is raised.
    Contacts that come near to further sharp edges are kept away from these as well.
    """
    edge_points, (on_faces, snapped) = [candidate.points], fix_to_triangles(compiled, candidate)
    if on_faces.violation(snapped) > FEASIBLE:
        touched, moved, violation = project_onto_body(compiled, candidate)
        on_faces, snapped = (touched, moved) if violation <= TOUCHING else (on_faces, snapped)
    lacking = overestimated_clearance(compiled, snapped)
    while True:
        widened, initial = on_faces, snapped
        if lacking.any():
            widened = on_faces.with_clearance(lacking)
            moved, violation = project_onto_constraints(widened, snapped)
            initial = moved if violation <= TOUCHING else snapped
        _, result = refine_with_margins(widened, initial, deadline)
        on_body = put_on_body(compiled, on_faces, result.point.candidate)
        if on_faces is compiled or on_body.is_feasible or len(edge_points) == PASSES or deadline.should_stop():
            return on_body, result
        lacking += missing_clearance(compiled, on_body)
        edge_points.append(result.point.candidate.points)
        on_faces, _ = fix_to_triangles(compiled, snapped, edge_points)


def missing_clearance(compiled: CompiledProblem, on_body: GraspOnBody) -> FloatArray:
    """Return the clearance that links lack from the body, metres, (rows,); 0 for other constraints."""
    lacking = np.zeros(len(compiled.rows.named))
    rows = compiled.rows.clearances
    lacking[rows] = [max(compiled.rows.named[i].lower - on_body.values[i], 0.0) for i in rows]
    return lacking


def overestimated_clearance(compiled: CompiledProblem, candidate: GraspCandidate) -> FloatArray:
    """Return by how much the smooth distance of links from a mesh exceeds that from the mesh itself, metres, (rows,).

    0 for other constraints, and where the smooth distance is the smaller one.
    """
    excess, rows, body = np.zeros(len(compiled.rows.named)), compiled.rows.clearances, compiled.problem.body
    if len(rows) and isinstance(body, Mesh):
        points = candidate.points[None]  # these constraints depend on the hand alone
        smooth = compiled.rows.values(points, np.zeros_like(points), candidate.repeated_hand(1))[0, rows]
        excess[rows] = np.maximum(smooth - compiled.hand_functions.mesh_clearances(body, candidate.hand), 0.0)
    return excess


def advance_on_body(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> RefinementResult:
    """Return a candidate after a few rounds of refinement on the body.

    A posed hand on a mesh is refined on the mesh's smoothed surface if it can touch that, otherwise on the triangles.
    """
    body, rounds = compiled.problem.body, min(ROUNDS, compiled.options.rounds)
    if not isinstance(body, Mesh):
        return advance(compiled, compiled.projected_onto_faces(candidate), deadline, rounds)
    if not compiled.follows_contacts:
        moved, violation = project_onto_constraints(
            compiled, compiled.projected_onto_faces(replace(candidate, faces=body.face_names * len(candidate.faces)))
        )
        if violation <= TOUCHING:
            return advance(compiled, compiled.projected_onto_faces(moved), deadline, rounds)
    return advance(
        *fix_to_triangles(compiled, replace(candidate, points=body.closest(candidate.points)[0])), deadline, rounds
    )


def refine_with_margins(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline, least: float = LEAST_GAIN
) -> tuple[CompiledProblem, RefinementResult]:
    """Return the compiled problem with joint limits narrowed by margins, and the refined candidate.

    A hand that keeps margins is refined several times in a start, so no certificates look for missed directions yet.

    Parameters
    ----------
    compiled : CompiledProblem
        For a hand with joints; other problems are refined without margins.
    candidate : GraspCandidate
        Contacts and hand, whose joints may be anywhere in their ranges.
    deadline : Deadline
    least : float
        Relative gain below which a round is idle.
    """
    hand, options = compiled.problem.hand, compiled.options
    if not isinstance(hand, URDFHand) or not options.seeks_room:
        return compiled, refine(compiled, candidate, deadline)
    margins = JointLimitMargins.of(hand, options.joint_margin)
    keeps_margin, candidate = _joints_with_margin(compiled, margins, candidate)
    narrowed = compiled.with_joint_limits(margins.narrow_limits(keeps_margin))
    result = advance(narrowed, candidate, deadline, least=least)
    costly = _costly_margins(narrowed, result, keeps_margin * margins.wanted)
    if np.any(costly):
        narrowed = compiled.with_joint_limits(margins.narrow_limits(keeps_margin & ~costly))
        result = advance(narrowed, result.point.candidate, deadline, least=least)
    return narrowed, result


def _around_smooth_surface(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> GraspCandidate:
    """Return a candidate with a posed hand after coarse refinement on a mesh's smoothed surface.

    Contacts move farther on it than on triangles. A candidate that cannot be projected onto the constraints is returned
    unchanged.
    """
    moved, violation = project_onto_constraints(compiled, compiled.projected_onto_faces(candidate))
    if violation > TOUCHING:
        return candidate
    return refine_with_margins(compiled, compiled.projected_onto_faces(moved), deadline, COARSE)[1].point.candidate


def _joints_with_margin(
    compiled: CompiledProblem, margins: JointLimitMargins, candidate: GraspCandidate
) -> tuple[BoolArray, GraspCandidate]:
    """Return the mask (m,) of joints that can keep their margins while all fingertips touch, and such a candidate."""
    lacking = margins.is_below_margin(candidate.hand["joints"])
    for keeps_margin in (np.ones_like(lacking), ~lacking) if np.any(lacking) else ():
        limits = margins.narrow_limits(keeps_margin)
        clipped = np.clip(candidate.hand["joints"], limits[0], limits[1])
        narrowed = compiled.with_joint_limits(limits)
        hand = {**candidate.hand, "joints": clipped}
        moved, violation = project_onto_constraints(narrowed, replace(candidate, hand=hand))
        if violation <= TOUCHING:
            return keeps_margin, narrowed.projected_onto_faces(moved)
    return ~lacking, candidate


def _costly_margins(compiled: CompiledProblem, result: RefinementResult, margins: FloatArray) -> BoolArray:
    """Return the mask of joints (m,) whose margins are given up, so that the rest cost at most ``room_price``."""
    point, program = result.point, compiled.cutting_planes.functions.program
    costly = np.zeros(len(margins), dtype=bool)
    if point.value <= 0.0:
        return costly
    linear = Linearisation(compiled, point.candidate, nearest_to_binding(compiled, point.candidate, point.cuts))
    step = linear.quadratic_step(NEARBY)
    if step is None:
        return costly
    joints = next(block for name, block in program.hand_blocks if name == "joints")
    # decrease of mu per unit of range
    rates = np.abs(step.bound_multipliers[joints.range]) / (joints.scale * compiled.scaling.beta)
    costs = rates * margins / point.value
    cheapest = np.argsort(costs)
    costly[cheapest] = np.cumsum(costs[cheapest]) > compiled.options.room_price
    return costly
