"""Hand record of a grasp, and choice of a grasp with a collision-free approach.

Pregrasp and the palm's path to it are computed in ``nlpgrasp.motion``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.hands import URDFHand
from nlpgrasp.motion.keyframes import plan_keyframes
from nlpgrasp.motion.pregrasp import find_pregrasp
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.local_convergence import converge_to_optimum
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.solution.obstructions import approach_obstructions, links_are_free
from nlpgrasp.solution.records import Status


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
    model, links, clearances = problem.hand, compiled.link_depths, compiled.collision_model
    if isinstance(model, URDFHand) and links is not None and clearances is not None:
        normals, clearance = start.on_body.grasp.normals, compiled.options.pregrasp_clearance
        pregrasp, message = attempt(lambda: find_pregrasp(clearances, candidate.hand, normals, clearance))
        start = start.with_message(message and f"no pregrasp: {message}")
        if pregrasp is not None:
            hand["pregrasp"] = {"clearance": pregrasp.clearance, **model.describe(pregrasp.hand)}
        opened = None if pregrasp is None else pregrasp.hand
        phases, message = attempt(lambda: plan_keyframes(problem, model, candidate.hand, opened, links, clearances))
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
