"""Refinement of candidates on the body itself, on a mesh on its triangles, and under joint-limit margins.

On a mesh, refinement with each contact on its triangle alternates with coordinate exchange over mesh points nearby
(``refine_on_body``).

Where joints of a hand are to stay off their limits, their ranges are narrower by the margins (``refine_with_margins``).
Joints that cannot go inside where the fingertips touch keep their whole range; so do those whose margins take more of
mu, to first order by their multipliers, than the price.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import exchange_nearby
from nlpgrasp.optimize.cutting_planes import most_relevant
from nlpgrasp.optimize.finger_exchange import walked
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.local_search import RefinementResult, advance, refine
from nlpgrasp.optimize.projection import (
    TOUCHING,
    fix_to_triangles,
    project_onto_constraints,
    put_on_body,
    touching_on_body,
)
from nlpgrasp.optimize.trust_region import Linearisation
from nlpgrasp.solution.analysis_records import SMALL, JointMargins

SHARE = 0.1  # share of a joint's range: upper bound on its margin
NEARBY = 1e-3  # over the body's size: trust-region radius of the linearised program that prices the margins
PASSES = 4  # refinements on triangles, at most, while contacts come too near to further sharp edges of a mesh
ROUNDS = 4  # rounds of refinement of a candidate before it is compared with others
EXCHANGES, GAIN = 4, 2e-3  # coordinate exchanges on a mesh, at most; least relative gain of one


def refine_on_body(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Return the local optimum reached from a candidate, with its grasp on the body itself.

    On a mesh, refinement on triangles alternates with coordinate exchange over mesh points nearby.
    """
    body = compiled.problem.body
    if not isinstance(body, Mesh):
        return refine_on_triangles(compiled, compiled.snapped(candidate), deadline)
    if compiled.follows_contacts:
        candidate = replace(candidate, points=body.closest(candidate.points)[0])
    else:
        candidate = _around_smooth_surface(
            compiled, replace(candidate, faces=body.face_names * len(candidate.faces)), deadline
        )
    found, refined = refine_on_triangles(compiled, candidate, deadline)
    for _ in range(EXCHANGES):
        value = refined.point.value
        if deadline.is_requested() or value <= 0.0 or not compiled.options.rounds:
            break
        moved = _exchanged(compiled, found, refined, deadline)
        if moved is None:
            break
        trial, there = refine_on_triangles(compiled, moved, deadline)
        if (trial.is_feasible, there.point.value) <= (found.is_feasible, (1.0 + GAIN) * value):
            break
        found, refined = trial, replace(there, history=refined.history + there.history)
    return found, refined


def refine_on_triangles(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Return the local optimum reached from a candidate on the body; contacts on a mesh stay on their triangles.

    Where the smooth distance flatters the clearance of links from the mesh, it has to be larger by what they lack.
    Contacts that come near to further sharp edges are kept away from these as well.
    """
    places, (own, begin) = [candidate.points], fix_to_triangles(compiled, candidate)
    if own.violation(begin) > FEASIBLE:
        touched, moved, left = touching_on_body(compiled, candidate)
        own, begin = (touched, moved) if left <= TOUCHING else (own, begin)
    short = np.zeros(len(compiled.rows.named))
    while True:
        _, refined = refine_with_margins(own.with_clearance(short) if short.any() else own, begin, deadline)
        found = put_on_body(compiled, own, refined.point.candidate)
        if own is compiled or found.is_feasible or len(places) == PASSES or deadline.is_requested():
            return found, refined
        short += missing_clearance(compiled, found)
        places.append(refined.point.candidate.points)
        own, _ = fix_to_triangles(compiled, begin, places)


def missing_clearance(compiled: CompiledProblem, found: GraspOnBody) -> FloatArray:
    """Return each link's violation of its clearance from the body, (rows,), metres."""
    short = np.zeros(len(compiled.rows.named))
    rows = compiled.rows.clearances
    short[rows] = [max(compiled.rows.named[i].lower - found.values[i], 0.0) for i in rows]
    return short


def advanced_on_body(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> RefinementResult:
    """Return a candidate after a few rounds of refinement: on the body, a hand around the smooth surface of a mesh."""
    body = compiled.problem.body
    if not isinstance(body, Mesh):
        return advance(compiled, compiled.snapped(candidate), deadline, ROUNDS)
    if not compiled.follows_contacts:
        moved, left = project_onto_constraints(
            compiled, compiled.snapped(replace(candidate, faces=body.face_names * len(candidate.faces)))
        )
        if left <= TOUCHING:
            return advance(compiled, compiled.snapped(moved), deadline, ROUNDS)
    return advance(
        *fix_to_triangles(compiled, replace(candidate, points=body.closest(candidate.points)[0])), deadline, ROUNDS
    )


def refine_with_margins(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[CompiledProblem, RefinementResult]:
    """Return the refined candidate, and the compiled problem with the joint limits used.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem whose hand has a pose.
    candidate : GraspCandidate
        Contacts and hand, whose joints may be anywhere in their ranges.
    deadline : Deadline
    """
    hand, options = compiled.problem.hand, compiled.options
    if not isinstance(hand, URDFHand) or not options.seeks_room:
        return compiled, refine(compiled, candidate, deadline)
    margins = JointLimitMargins.of(hand, options.joint_margin)
    inside, candidate = _joints_with_margin(compiled, margins, candidate)
    own = compiled.with_joints(margins.narrow_limits(inside))
    refined = refine(own, candidate, deadline)
    dear = _costly_margins(own, refined, inside * margins.wanted)
    if np.any(dear):
        own = compiled.with_joints(margins.narrow_limits(inside & ~dear))
        refined = refine(own, refined.point.candidate, deadline)
    return own, refined


@dataclass(frozen=True)
class JointLimitMargins:
    """Free joints of a hand with their limits and required margins.

    Parameters
    ----------
    names : tuple of m str
    limits : (2, m) array
        Radians, metres of joints that slide.
    wanted : (m,) array
        A tenth of each range at most, and exactly that of joints that slide.
    """

    names: tuple[str, ...]
    limits: FloatArray
    wanted: FloatArray

    @classmethod
    def of(cls, hand: URDFHand, margin: float) -> JointLimitMargins:
        """Return the margins of a hand's joints, from a margin in radians."""
        limits, joints = hand.tree.joint_limits, hand.robot.free_joints
        share = SHARE * (limits[1] - limits[0])
        turns = np.array([joint.is_revolute for joint in joints])
        wanted = np.where(turns, np.minimum(margin, share), share)
        return cls(tuple(joint.name for joint in joints), limits, wanted)

    def distances_to_limits(self, joints: FloatArray) -> FloatArray:
        """Return the distances of joints (m,) from their nearer limits, (m,)."""
        return np.asarray(np.minimum(joints - self.limits[0], self.limits[1] - joints))

    def distances_by_name(self, joints: FloatArray) -> dict[str, float]:
        """Return the distances of joints (m,) from their nearer limits, by name."""
        return dict(zip(self.names, self.distances_to_limits(joints).tolist(), strict=True))

    def margins_record(self, joints: FloatArray, margin: float, price: float) -> JointMargins:
        """Return the joint-limit margins of joints (m,) as files state them, beside the required ones."""
        return JointMargins(
            margin, dict(zip(self.names, self.wanted.tolist(), strict=True)), self.distances_by_name(joints), price
        )

    def is_below_margin(self, joints: FloatArray) -> NDArray[np.bool_]:
        """Return the mask of joints (m,) with less than their margin, (m,)."""
        return np.asarray(self.distances_to_limits(joints) < (1.0 - SMALL) * self.wanted)

    def narrow_limits(self, chosen: NDArray[np.bool_]) -> FloatArray:
        """Return the limits, (2, m), narrowed by the margins of the chosen joints, (m,) of bool."""
        inside = np.where(chosen, self.wanted, 0.0)
        return np.stack([self.limits[0] + inside, self.limits[1] - inside])


def _around_smooth_surface(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> GraspCandidate:
    """Return a hand refined around a mesh's smooth surface, where its contacts move farther than on triangles."""
    moved, left = project_onto_constraints(compiled, compiled.snapped(candidate))
    return (
        candidate
        if left > TOUCHING
        else refine_with_margins(compiled, compiled.snapped(moved), deadline)[1].point.candidate
    )


def _exchanged(
    compiled: CompiledProblem, found: GraspOnBody, refined: RefinementResult, deadline: Deadline
) -> GraspCandidate | None:
    """Return contacts moved to better mesh points nearby that the hand reaches; None where none are better."""
    if compiled.follows_contacts:
        return exchange_nearby(compiled, refined.point.candidate, found.grasp, refined.point.cuts)
    return walked(compiled, found.candidate, found.grasp.normals, np.random.default_rng(0), deadline)


def _joints_with_margin(
    compiled: CompiledProblem, margins: JointLimitMargins, candidate: GraspCandidate
) -> tuple[NDArray[np.bool_], GraspCandidate]:
    """Return the mask of joints that can keep their margins with all fingertips touching, (m,), and the hand there."""
    lacking = margins.is_below_margin(candidate.hand["joints"])
    for inside in (np.ones_like(lacking), ~lacking) if np.any(lacking) else ():
        limits = margins.narrow_limits(inside)
        clipped = np.clip(candidate.hand["joints"], limits[0], limits[1])
        own = compiled.with_joints(limits)
        moved, left = project_onto_constraints(own, replace(candidate, hand={**candidate.hand, "joints": clipped}))
        if left <= TOUCHING:
            return inside, own.snapped(moved)
    return ~lacking, candidate


def _costly_margins(compiled: CompiledProblem, refined: RefinementResult, margins: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of joints, (m,), whose margins are dropped so that the others cost little enough of mu."""
    point, program = refined.point, compiled.cutting_planes.functions.program
    nothing = np.zeros(len(margins), dtype=bool)
    if point.value <= 0.0 or not compiled.cutting_planes.linearises:
        return nothing
    linear = Linearisation(compiled, point.candidate, most_relevant(compiled, point.candidate, point.cuts))
    step = linear.quadratic_step(NEARBY)
    if step is None:
        return nothing
    joints = next(block for name, block in program.hand_blocks if name == "joints")
    gain = np.abs(step.bound_multipliers[joints.range]) / (
        joints.scale * compiled.scaling.beta
    )  # of mu, a unit of range
    cost = gain * margins / point.value
    cheapest = np.argsort(cost)
    nothing[cheapest] = np.cumsum(cost[cheapest]) > compiled.options.room_price
    return nothing
