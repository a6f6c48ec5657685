"""Pregrasp and approach of the answer's hand, and choice of a grasp with a collision-free approach.

The pregrasp opens the fingers along the contact normals, in stages of growing clearance with Newton steps on the
constraints (``find_pregrasp``). The path of the palm to it is computed in ``nlpgrasp.motion``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.quadratic_program import Linearised, NewtonRules, restore_feasibility, step_bounds
from nlpgrasp.common.scalar_constraints import ON_FINGERTIP
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.keyframes import plan_keyframes
from nlpgrasp.nlp import HAND
from nlpgrasp.optimize.compiled_problem import CompiledProblem, hand_of, pack_variables, set_contacts
from nlpgrasp.optimize.cutting_planes import empty_slots
from nlpgrasp.optimize.final_step import converge_to_optimum
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.refine import JointLimitMargins
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.solution.obstructions import approach_obstructions

STAGES = 4  # the pregrasp's clearance grows in stages, each with a few Newton steps
STAGE = NewtonRules(steps=8, enough=1e-6)  # solver units: tolerance of a stage
FINEST = 0.02  # smallest stage tried, as a share of the requested clearance
ENOUGH = 0.2  # share of the requested clearance above which the palm does not move
LONGEST = 0.2  # longest step, radians or solver units
T = TypeVar("T")
IntArray = NDArray[np.intp]


def choose_free_approach(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], deadline: Deadline
) -> tuple[StartGrasp, ...]:
    """Return the start that is the answer, with its approach, then others whose approach is blocked.

    That is the best one where its way is free; else the next in the order of mu whose way is, and the best one again
    where there is none.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The best start, by quality and robustness.
    results : sequence of StartResult
        All of them.
    deadline : Deadline
    """
    with single_thread():
        first = add_hand_record(compiled, best)
        if not first.record.obstruction or not first.solved:
            return (first,)
        blocked = [first]
        others = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.index != best.record.index]
        for other in sorted(others, key=lambda r: (-r.record.mu.upper, r.record.index)):
            if deadline.is_requested():
                break
            found = add_hand_record(compiled, converge_to_optimum(compiled, other, deadline))
            if found.solved and not found.record.obstruction:
                return (found, *blocked)
            blocked.append(found)
        return tuple(blocked)


def add_hand_record(compiled: CompiledProblem, start: StartGrasp) -> StartGrasp:
    """Return a start with its hand record: posture, pregrasp, phases, penetration of its links."""
    problem, candidate = compiled.problem, start.on_body.candidate
    hand = hand_posture(compiled, start)
    if hand is None:
        return start
    if not compiled.follows_contacts:
        opened, message = attempt(lambda: find_pregrasp(compiled, start.on_body, compiled.options.pregrasp_clearance))
        start = start.with_message(message and f"no pregrasp: {message}")
        model, links = problem.hand, compiled.link_depths
        if opened is not None and model is not None:
            hand["pregrasp"] = {"clearance": opened.clearance, **model.describe(opened.hand)}
        if isinstance(model, URDFHand) and links is not None:
            before = None if opened is None else opened.hand
            phases, message = attempt(lambda: plan_keyframes(problem, model, candidate.hand, before, links))
            start, hand = start.with_message(message and f"no phases: {message}"), {**hand, **(phases or {})}
    if start.record.obstruction:
        return replace(start, hand=hand)
    return replace(start, hand=hand, record=replace(start.record, obstruction="; ".join(approach_obstructions(hand))))


def hand_posture(compiled: CompiledProblem, start: StartGrasp) -> dict[str, object] | None:
    """Return the hand in the grasp as JSON data, None without any."""
    hand, found = compiled.problem.hand, start.on_body
    if hand is None:
        return None
    data = dict(hand.describe(found.candidate.hand)) if found.candidate.hand else {}
    data |= compiled.hand_points.at_contacts(found.grasp.points)
    if not data:
        return None
    if start.depth is not None:
        data["link_depth"] = start.depth.to_dict()
    if start.tip_gaps:
        data["tip_gaps"] = list(start.tip_gaps)
    if isinstance(hand, URDFHand) and compiled.options.seeks_room:
        margins, options = JointLimitMargins.of(hand, compiled.options.joint_margin), compiled.options
        data["room"] = margins.margins_record(
            found.candidate.hand["joints"], options.joint_margin, options.room_price
        ).to_dict()
    return data


@dataclass(frozen=True)
class Pregrasp:
    """Hand configuration just before contact.

    Parameters
    ----------
    clearance : float
        Distance that every fingertip has moved away along its contact normal, metres.
    hand : dict
        Values of the hand's variables; the palm is turned as in the grasp, and where it is there if joints are enough.
    """

    clearance: float
    hand: Values


def find_pregrasp(compiled: CompiledProblem, found: GraspOnBody, clearance: float) -> Pregrasp:
    """Return joints that open the hand along the contact normals, free of collision.

    The joints move as little as they can while each fingertip goes back by the clearance along its normal, links
    and fingertips stay off the body, off each other and within all constraints. Where the joints alone do not
    allow that, the largest clearance that they reach is returned; where that is below a fifth the palm moves too.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem with a hand that has a pose.
    found : GraspOnBody
        The grasp.
    clearance : float
        Metres.
    """
    opening = _OpeningConstraints(compiled, found)
    best = opening.open(clearance, ("joints",))
    if best.clearance < ENOUGH * clearance:
        best = max(best, opening.open(clearance, ("joints", "palm_position")), key=lambda p: p.clearance)
    return best


class _OpeningConstraints:
    """Constraints of an opening hand: those of the program, and each fingertip's distance from its contact."""

    def __init__(self, compiled: CompiledProblem, found: GraspOnBody) -> None:
        self.compiled, self.hand, self.normals = compiled, found.candidate.hand, found.grasp.normals
        self.functions = compiled.cutting_planes.functions
        self.theta = empty_slots(compiled, found.candidate)
        self.start = pack_variables(compiled, self.functions.program, found.candidate)
        set_contacts(compiled, self.functions.program, self.start, found.grasp.points, found.grasp.normals)
        own = compiled.rows.sources[len(compiled.problem.constraints)]
        touching = {i for i in own if compiled.rows.named[i].kind == ON_FINGERTIP}
        self.kept = np.array([i for i in range(len(compiled.rows.named)) if i not in touching], int)
        self.near = np.flatnonzero(np.isin(self.kept, compiled.rows.clearances))
        self.tips = compiled.hand_points.tip_motion
        self.begin = self.tips(*self.hand.values())[0].full()

    def open(self, clearance: float, moving: tuple[str, ...]) -> Pregrasp:
        """Return the hand opened as far as possible with some of its variables."""
        program, z = self.functions.program, self.start.copy()
        free = np.concatenate([np.arange(b.start, b.stop) for b in (program.block(HAND, name) for name in moving)])
        best = Pregrasp(0.0, self.hand)
        more = clearance / STAGES
        while more > clearance * FINEST and best.clearance < clearance:
            aim = min(best.clearance + more, clearance)
            there = self._opened(z, free, aim)
            if there is None:
                more /= 2.0
            else:
                z, best = there, Pregrasp(aim, hand_of(program, there))
        return best

    def _opened(self, z: FloatArray, free: IntArray, back: float) -> FloatArray | None:
        """Return the variables with every fingertip back by a distance, by Newton steps from z; None if they fail."""

        def candidate(moved: FloatArray) -> FloatArray:
            result = z.copy()
            result[free] = moved
            return result

        found = restore_feasibility(lambda moved: self._rows(candidate(moved), free, back), z[free], STAGE)
        return candidate(found.best) if found.violation <= STAGE.enough else None

    def _rows(self, z: FloatArray, free: IntArray, back: float) -> Linearised:
        """Return the constraints linearised in the free variables, without those that do not depend on them."""
        compiled, program = self.compiled, self.functions.program
        size, here = compiled.scaling.length, hand_of(program, z)
        rows = self.kept + program.placement.start
        g, J = self.functions.linearise(z, self.theta)
        g, J = g[rows], J[rows][:, free]
        if isinstance(compiled.problem.body, Mesh) and len(self.near):
            g[self.near] = compiled.hand_points.mesh_clearances(compiled.problem.body, here) / size
        places, slopes = (np.asarray(m.full()) for m in self.tips(*here.values()))
        gone = np.sum((places - self.begin) * -self.normals.T, axis=0) / size  # along the outward normals
        blocks = [program.block(HAND, name) for name in here]
        scales = np.concatenate([np.full(b.stop - b.start, b.scale) for b in blocks])
        first = blocks[0].start
        along = np.stack([-n @ slopes[3 * i : 3 * i + 3] for i, n in enumerate(self.normals)]) * scales / size
        seen = np.abs(J).sum(axis=1) > 1e-9
        low, high = (limits[rows][seen] for limits in program.limits)
        aim = np.full(len(gone), back / size)
        return Linearised(
            np.concatenate([gone, g[seen]]),
            np.concatenate([along[:, free - first], J[seen]]),
            np.concatenate([aim, low]),
            np.concatenate([aim, high]),
            *step_bounds(z[free], (program.bounds[0][free], program.bounds[1][free]), LONGEST),
        )
