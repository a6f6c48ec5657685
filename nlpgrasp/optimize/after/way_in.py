"""Hand record of a grasp with its approach, and choice of a grasp with a collision-free approach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.hands import URDFHand
from nlpgrasp.motion.phases.keyframes import keyframes
from nlpgrasp.optimize.after.final_step import at_local_optimum
from nlpgrasp.optimize.after.pregrasp import pregrasp
from nlpgrasp.optimize.posture.margins import Margins
from nlpgrasp.optimize.start.result import StartGrasp, StartResult
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.optimize.workers.one_thread import one_thread
from nlpgrasp.solution.obstructions import of_the_way

T = TypeVar("T")


def with_free_way(
    bench: Workbench, best: StartGrasp, results: Sequence[StartResult], stop: Stop
) -> tuple[StartGrasp, ...]:
    """Return the start that is the answer, with its approach, then others whose approach is blocked.

    That is the best one where its way is free; else the next in the order of mu whose way is, and the best one again
    where there is none.

    Parameters
    ----------
    bench : Workbench
    best : StartGrasp
        The best start, by quality and robustness.
    results : sequence of StartResult
        All of them.
    stop : Stop
    """
    with one_thread():
        first = approached(bench, best)
        if not first.record.obstruction or not first.solved:
            return (first,)
        blocked = [first]
        others = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.index != best.record.index]
        for other in sorted(others, key=lambda r: (-r.record.mu.upper, r.record.index)):
            if stop.requested():
                break
            found = approached(bench, at_local_optimum(bench, other, stop))
            if found.solved and not found.record.obstruction:
                return (found, *blocked)
            blocked.append(found)
        return tuple(blocked)


def approached(bench: Workbench, start: StartGrasp) -> StartGrasp:
    """Return a start with its hand record: posture, pregrasp, phases, penetration of its links."""
    problem, placed = bench.problem, start.found.placed
    hand = hand_posture(bench, start)
    if hand is None:
        return start
    if not bench.follows_contacts:
        opened = attempted(lambda: pregrasp(bench, start.found, bench.options.pregrasp_clearance))
        model, links = problem.hand, bench.link_depths
        if opened is not None and model is not None:
            hand["pregrasp"] = {"clearance": opened.clearance, **model.describe(opened.hand)}
        if isinstance(model, URDFHand) and links is not None:
            before = None if opened is None else opened.hand
            hand |= attempted(lambda: keyframes(problem, model, placed.hand, before, links)) or {}
    if start.record.obstruction:
        return replace(start, hand=hand)
    return replace(start, hand=hand, record=replace(start.record, obstruction="; ".join(of_the_way(hand))))


def hand_posture(bench: Workbench, start: StartGrasp) -> dict[str, object] | None:
    """Return the hand in the grasp as JSON data, None without any."""
    hand, found = bench.problem.hand, start.found
    if hand is None:
        return None
    data = dict(hand.describe(found.placed.hand)) if found.placed.hand else {}
    data |= bench.hand_points.at_contacts(found.grasp.points)
    if not data:
        return None
    if start.depth is not None:
        data["link_depth"] = start.depth.to_dict()
    if start.tip_gaps:
        data["tip_gaps"] = list(start.tip_gaps)
    if isinstance(hand, URDFHand) and bench.options.seeks_room:
        margins, options = Margins.of(hand, bench.options.joint_margin), bench.options
        data["room"] = margins.room(found.placed.hand["joints"], options.joint_margin, options.room_price).to_dict()
    return data


def attempted(work: Callable[[], T]) -> T | None:
    """Return the result of some work, or None where it fails numerically."""
    try:
        return work()
    except (RuntimeError, ArithmeticError, ValueError):
        return None
