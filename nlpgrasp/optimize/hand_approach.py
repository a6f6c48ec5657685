"""Pregrasp and approach of the answer's hand, and choice of a grasp with a collision-free approach.

The pregrasp opens the fingers along the contact normals, in stages of increasing clearance with Newton steps on the
constraints (``find_pregrasp``). The palm's path to it is computed in ``nlpgrasp.motion``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.quadratic_program import Linearised, NewtonRules, restore_feasibility, step_bounds
from nlpgrasp.common.scalar_constraints import ON_FINGERTIP
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.keyframes import plan_keyframes
from nlpgrasp.nlp import HAND
from nlpgrasp.optimize.compiled_problem import CompiledProblem, hand_of, pack_variables, set_contacts
from nlpgrasp.optimize.cutting_planes import parameters_without_cuts
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.local_convergence import converge_to_optimum
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.solution.obstructions import approach_obstructions, links_are_free
from nlpgrasp.solution.records import Status

STAGES = 4  # stages of increasing clearance of the pregrasp
STAGE = NewtonRules(steps=8, enough=1e-6)  # Newton steps of a stage; tolerance, solver units
FINEST = 0.02  # smallest stage, as a share of the requested clearance
ENOUGH = 0.2  # share of the requested clearance below which the palm moves as well
LONGEST = 0.2  # longest Newton step, radians or solver units
T = TypeVar("T")


def choose_free_approach(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], deadline: Deadline
) -> tuple[StartGrasp, ...]:
    """Return the chosen start, with a collision-free approach if possible, followed by the blocked ones.

    Chosen is the best start if its approach is collision-free, else the next by decreasing mu whose approach is, else
    the best whose links do not penetrate anything on the way in.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The best start by quality and robustness.
    results : sequence of StartResult
        Results of all starts.
    deadline : Deadline
    """
    with single_thread():
        answer = add_hand_record(compiled, best)
        if not answer.record.obstruction or not best.solved:
            return (answer,)
        blocked = [answer]
        others = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.index != best.record.index]
        for other in sorted(others, key=lambda r: (-r.record.mu.upper, r.record.index)):
            if deadline.should_stop():
                break
            converged = add_hand_record(compiled, converge_to_optimum(compiled, other, deadline))
            if converged.solved and not converged.record.obstruction:
                return (converged, *blocked)
            blocked.append(converged)
        return tuple(sorted(blocked, key=lambda start: not start.solved))  # no link inside anything on the way in


def add_hand_record(compiled: CompiledProblem, start: StartGrasp) -> StartGrasp:
    """Return a start with its hand record: posture, pregrasp, motion phases and link penetration."""
    problem, candidate = compiled.problem, start.on_body.candidate
    hand = hand_posture(compiled, start)
    if hand is None:
        return start
    if not compiled.follows_contacts:
        pregrasp, message = attempt(lambda: find_pregrasp(compiled, start.on_body, compiled.options.pregrasp_clearance))
        start = start.with_message(message and f"no pregrasp: {message}")
        model, links, spheres = problem.hand, compiled.link_depths, compiled.collision_model
        if pregrasp is not None and model is not None:
            hand["pregrasp"] = {"clearance": pregrasp.clearance, **model.describe(pregrasp.hand)}
        if isinstance(model, URDFHand) and links is not None:
            opened = None if pregrasp is None else pregrasp.hand
            phases, message = attempt(lambda: plan_keyframes(problem, model, candidate.hand, opened, links, spheres))
            start, hand = start.with_message(message and f"no phases: {message}"), {**hand, **(phases or {})}
    if start.record.obstruction:
        return replace(start, hand=hand)
    touches = start.solved and not links_are_free(hand)
    status, obstruction = Status.TOUCHES if touches else start.record.status, "; ".join(approach_obstructions(hand))
    return replace(start, hand=hand, record=replace(start.record, status=status, obstruction=obstruction))


def hand_posture(compiled: CompiledProblem, start: StartGrasp) -> dict[str, object] | None:
    """Return the hand's posture, link penetration and joint margins as JSON data; None without a hand."""
    hand, on_body = compiled.problem.hand, start.on_body
    if hand is None:
        return None
    data = dict(hand.describe(on_body.candidate.hand)) if on_body.candidate.hand else {}
    points, functions = on_body.grasp.points, compiled.hand_functions
    data |= functions.name_obstacles(points, functions.at_contacts(points))
    if not data:
        return None
    if start.depth is not None:
        data["link_depth"] = start.depth.to_dict()
    if start.tip_gaps:
        data["tip_gaps"] = list(start.tip_gaps)
    if isinstance(hand, URDFHand) and compiled.options.seeks_room:
        margins, options = JointLimitMargins.of(hand, compiled.options.joint_margin), compiled.options
        data["room"] = margins.margins_record(
            on_body.candidate.hand["joints"], options.joint_margin, options.room_price
        ).to_dict()
    return data


@dataclass(frozen=True)
class Pregrasp:
    """Hand configuration before contact.

    Parameters
    ----------
    clearance : float
        Distance that every fingertip has moved away along its contact normal, metres.
    hand : dict
        Values of the hand's variables. The palm has the orientation of the grasp, and its position if joints suffice.
    """

    clearance: float
    hand: Values


def find_pregrasp(compiled: CompiledProblem, on_body: GraspOnBody, clearance: float) -> Pregrasp:
    """Return the pregrasp of a grasp: the hand opened along the contact normals, free of collision.

    Each fingertip moves back by the clearance along its normal with the least motion of the joints; all constraints
    hold, and links and fingertips avoid the body and each other. Where the joints alone do not suffice, the pregrasp
    has the largest clearance that they reach; where that is below a fifth, the palm moves as well.

    Parameters
    ----------
    compiled : CompiledProblem
        Problem with a hand that has a pose.
    on_body : GraspOnBody
        The grasp.
    clearance : float
        Metres.
    """
    opening = _HandOpening(compiled, on_body)
    best = opening.open(clearance, ("joints",))
    if best.clearance < ENOUGH * clearance:
        best = max(best, opening.open(clearance, ("joints", "palm_position")), key=lambda p: p.clearance)
    return best


class _HandOpening:
    """Opening of a hand under the program's constraints, with each fingertip at a distance from its contact."""

    def __init__(self, compiled: CompiledProblem, on_body: GraspOnBody) -> None:
        self.compiled, self.hand, self.normals = compiled, on_body.candidate.hand, on_body.grasp.normals
        self.functions = compiled.cutting_planes.functions
        self.theta = parameters_without_cuts(compiled, on_body.candidate)
        self.initial = pack_variables(compiled, self.functions.program, on_body.candidate)
        set_contacts(compiled, self.functions.program, self.initial, on_body.grasp.points, on_body.grasp.normals)
        of_hand = compiled.rows.sources[len(compiled.problem.constraints)]
        touching = {i for i in of_hand if compiled.rows.named[i].kind == ON_FINGERTIP}
        self.indices = np.array([i for i in range(len(compiled.rows.named)) if i not in touching], int)
        self.clearances = np.flatnonzero(np.isin(self.indices, compiled.rows.clearances))
        self.tip_motion = compiled.hand_functions.tip_jacobian_function
        self.contact_tips = self.tip_motion(*self.hand.values())[0].full()

    def open(self, clearance: float, moving: tuple[str, ...]) -> Pregrasp:
        """Return the hand opened as far as possible, up to a clearance, by moving some of its variables."""
        program, z = self.functions.program, self.initial.copy()
        free = np.concatenate([np.arange(b.start, b.stop) for b in (program.block(HAND, name) for name in moving)])
        best = Pregrasp(0.0, self.hand)
        increase = clearance / STAGES
        while increase > clearance * FINEST and best.clearance < clearance:
            distance = min(best.clearance + increase, clearance)
            opened = self._open_by(z, free, distance)
            if opened is None:
                increase /= 2.0
            else:
                z, best = opened, Pregrasp(distance, hand_of(program, opened))
        return best

    def _open_by(self, z: FloatArray, free: IntArray, distance: float) -> FloatArray | None:
        """Return variables with every fingertip at a distance from its contact; None if the Newton steps fail."""

        def with_free(values: FloatArray) -> FloatArray:
            result = z.copy()
            result[free] = values
            return result

        restored = restore_feasibility(
            lambda values: self._linearise(with_free(values), free, distance), z[free], STAGE
        )
        return with_free(restored.best) if restored.violation <= STAGE.enough else None

    def _linearise(self, z: FloatArray, free: IntArray, distance: float) -> Linearised:
        """Return the constraints linearised in the free variables, without those that do not depend on them."""
        program, rows = self.functions.program, self.indices + self.functions.program.placement.start
        g, J = self.functions.linearise(z, self.theta)
        g, J = g[rows], J[rows][:, free]
        body, hand, size = self.compiled.problem.body, hand_of(program, z), self.compiled.scaling.length
        if isinstance(body, Mesh) and len(self.clearances):
            g[self.clearances] = self.compiled.hand_functions.mesh_clearances(body, hand) / size
        distances, slopes = self._tip_distances(hand)
        first = program.block(HAND, next(iter(hand))).start
        dependent = np.abs(J).sum(axis=1) > 1e-9
        low, high = (limits[rows][dependent] for limits in program.limits)
        target = np.full(len(distances), distance / size)
        return Linearised(
            np.concatenate([distances, g[dependent]]),
            np.concatenate([slopes[:, free - first], J[dependent]]),
            np.concatenate([target, low]),
            np.concatenate([target, high]),
            *step_bounds(z[free], (program.bounds[0][free], program.bounds[1][free]), LONGEST),
        )

    def _tip_distances(self, hand: Values) -> tuple[FloatArray, FloatArray]:
        """Return the distance of each fingertip from its contact along the outward normal, and the Jacobian.

        Both are in solver units: (k,) and (k, m) for the hand's m variables.
        """
        size = self.compiled.scaling.length
        positions, jacobian = (np.asarray(m.full()) for m in self.tip_motion(*hand.values()))
        distances = np.sum((positions - self.contact_tips) * -self.normals.T, axis=0) / size
        blocks = [self.functions.program.block(HAND, name) for name in hand]
        scales = np.concatenate([np.full(b.stop - b.start, b.scale) for b in blocks])
        slopes = np.stack([-n @ jacobian[3 * i : 3 * i + 3] for i, n in enumerate(self.normals)]) * scales / size
        return distances, slopes
