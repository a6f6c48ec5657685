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
    bench: CompiledProblem, placed: GraspCandidate, stop: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Return the local optimum reached from a candidate, with its grasp on the body itself.

    On a mesh, refinement on triangles alternates with coordinate exchange over mesh points nearby.
    """
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return refine_on_triangles(bench, bench.snapped(placed), stop)
    if bench.follows_contacts:
        placed = replace(placed, points=body.closest(placed.points)[0])
    else:
        placed = _around_smooth_surface(bench, replace(placed, faces=body.face_names * len(placed.faces)), stop)
    found, refined = refine_on_triangles(bench, placed, stop)
    for _ in range(EXCHANGES):
        value = refined.point.value
        if stop.requested() or value <= 0.0 or not bench.options.rounds:
            break
        moved = _exchanged(bench, found, refined, stop)
        if moved is None:
            break
        trial, there = refine_on_triangles(bench, moved, stop)
        if (trial.allowed, there.point.value) <= (found.allowed, (1.0 + GAIN) * value):
            break
        found, refined = trial, replace(there, history=refined.history + there.history)
    return found, refined


def refine_on_triangles(
    bench: CompiledProblem, placed: GraspCandidate, stop: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Return the local optimum reached from a candidate on the body; contacts on a mesh stay on their triangles.

    Where the smooth distance flatters the clearance of links from the mesh, it has to be larger by what they lack.
    Contacts that come near to further sharp edges are kept away from these as well.
    """
    places, (own, begin) = [placed.points], fix_to_triangles(bench, placed)
    if own.violation(begin) > FEASIBLE:
        touched, moved, left = touching_on_body(bench, placed)
        own, begin = (touched, moved) if left <= TOUCHING else (own, begin)
    short = np.zeros(len(bench.rows.named))
    while True:
        _, refined = refine_with_margins(own.with_clearance(short) if short.any() else own, begin, stop)
        found = put_on_body(bench, own, refined.point.placed)
        if own is bench or found.allowed or len(places) == PASSES or stop.requested():
            return found, refined
        short += missing_clearance(bench, found)
        places.append(refined.point.placed.points)
        own, _ = fix_to_triangles(bench, begin, places)


def missing_clearance(bench: CompiledProblem, found: GraspOnBody) -> FloatArray:
    """Return each link's violation of its clearance from the body, (rows,), metres."""
    short = np.zeros(len(bench.rows.named))
    rows = bench.rows.clearances
    short[rows] = [max(bench.rows.named[i].lower - found.values[i], 0.0) for i in rows]
    return short


def advanced_on_body(bench: CompiledProblem, placed: GraspCandidate, stop: Deadline) -> RefinementResult:
    """Return a candidate after a few rounds of refinement: on the body, a hand around the smooth surface of a mesh."""
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return advance(bench, bench.snapped(placed), stop, ROUNDS)
    if not bench.follows_contacts:
        moved, left = project_onto_constraints(
            bench, bench.snapped(replace(placed, faces=body.face_names * len(placed.faces)))
        )
        if left <= TOUCHING:
            return advance(bench, bench.snapped(moved), stop, ROUNDS)
    return advance(*fix_to_triangles(bench, replace(placed, points=body.closest(placed.points)[0])), stop, ROUNDS)


def refine_with_margins(
    bench: CompiledProblem, placed: GraspCandidate, stop: Deadline
) -> tuple[CompiledProblem, RefinementResult]:
    """Return the refined candidate, and the compiled problem with the joint limits used.

    Parameters
    ----------
    bench : Workbench
        Of a problem whose hand has a pose.
    placed : Placed
        Contacts and hand, whose joints may be anywhere in their ranges.
    stop : Stop
    """
    hand, options = bench.problem.hand, bench.options
    if not isinstance(hand, URDFHand) or not options.seeks_room:
        return bench, refine(bench, placed, stop)
    margins = JointLimitMargins.of(hand, options.joint_margin)
    inside, placed = _joints_with_margin(bench, margins, placed)
    own = bench.with_joints(margins.narrowed(inside))
    refined = refine(own, placed, stop)
    dear = _costly_margins(own, refined, inside * margins.wanted)
    if np.any(dear):
        own = bench.with_joints(margins.narrowed(inside & ~dear))
        refined = refine(own, refined.point.placed, stop)
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
        turns = np.array([joint.turns for joint in joints])
        wanted = np.where(turns, np.minimum(margin, share), share)
        return cls(tuple(joint.name for joint in joints), limits, wanted)

    def left(self, joints: FloatArray) -> FloatArray:
        """Return the distances of joints (m,) from their nearer limits, (m,)."""
        return np.asarray(np.minimum(joints - self.limits[0], self.limits[1] - joints))

    def left_by_name(self, joints: FloatArray) -> dict[str, float]:
        """Return the distances of joints (m,) from their nearer limits, by name."""
        return dict(zip(self.names, self.left(joints).tolist(), strict=True))

    def room(self, joints: FloatArray, margin: float, price: float) -> JointMargins:
        """Return the joint-limit margins of joints (m,) as files state them, beside the required ones."""
        return JointMargins(
            margin, dict(zip(self.names, self.wanted.tolist(), strict=True)), self.left_by_name(joints), price
        )

    def lacking(self, joints: FloatArray) -> NDArray[np.bool_]:
        """Return the mask of joints (m,) with less than their margin, (m,)."""
        return np.asarray(self.left(joints) < (1.0 - SMALL) * self.wanted)

    def narrowed(self, chosen: NDArray[np.bool_]) -> FloatArray:
        """Return the limits, (2, m), narrowed by the margins of the chosen joints, (m,) of bool."""
        inside = np.where(chosen, self.wanted, 0.0)
        return np.stack([self.limits[0] + inside, self.limits[1] - inside])


def _around_smooth_surface(bench: CompiledProblem, placed: GraspCandidate, stop: Deadline) -> GraspCandidate:
    """Return a hand refined around a mesh's smooth surface, where its contacts move farther than on triangles."""
    moved, left = project_onto_constraints(bench, bench.snapped(placed))
    return placed if left > TOUCHING else refine_with_margins(bench, bench.snapped(moved), stop)[1].point.placed


def _exchanged(
    bench: CompiledProblem, found: GraspOnBody, refined: RefinementResult, stop: Deadline
) -> GraspCandidate | None:
    """Return contacts moved to better mesh points nearby that the hand reaches; None where none are better."""
    if bench.follows_contacts:
        return exchange_nearby(bench, refined.point.placed, found.grasp, refined.point.cuts)
    return walked(bench, found.placed, found.grasp.normals, np.random.default_rng(0), stop)


def _joints_with_margin(
    bench: CompiledProblem, margins: JointLimitMargins, placed: GraspCandidate
) -> tuple[NDArray[np.bool_], GraspCandidate]:
    """Return the mask of joints that can keep their margins with all fingertips touching, (m,), and the hand there."""
    lacking = margins.lacking(placed.hand["joints"])
    for inside in (np.ones_like(lacking), ~lacking) if np.any(lacking) else ():
        limits = margins.narrowed(inside)
        clipped = np.clip(placed.hand["joints"], limits[0], limits[1])
        own = bench.with_joints(limits)
        moved, left = project_onto_constraints(own, replace(placed, hand={**placed.hand, "joints": clipped}))
        if left <= TOUCHING:
            return inside, own.snapped(moved)
    return ~lacking, placed


def _costly_margins(bench: CompiledProblem, refined: RefinementResult, margins: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of joints, (m,), whose margins are dropped so that the others cost little enough of mu."""
    point, program = refined.point, bench.exchange.compiled.program
    nothing = np.zeros(len(margins), dtype=bool)
    if point.value <= 0.0 or not bench.exchange.linearises:
        return nothing
    linear = Linearisation(bench, point.placed, most_relevant(bench, point.placed, point.cuts))
    step = linear.quadratic_step(NEARBY)
    if step is None:
        return nothing
    joints = next(block for name, block in program.hand_blocks if name == "joints")
    gain = np.abs(step.bound_multipliers[joints.range]) / (joints.scale * bench.scaling.beta)  # of mu, a unit of range
    cost = gain * margins / point.value
    cheapest = np.argsort(cost)
    nothing[cheapest] = np.cumsum(cost[cheapest]) > bench.options.room_price
    return nothing
