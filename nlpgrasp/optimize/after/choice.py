"""Selection of the answer among the starts: prefers robust grasps that the hand can squeeze."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.hands.posed_hand import PosedHand
from nlpgrasp.optimize.after.robust import robustness
from nlpgrasp.optimize.start.result import StartGrasp, StartResult, best_of
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.optimize.workers.one_thread import one_thread
from nlpgrasp.quality.forces.least_friction import can_press

MOST = 3  # grasps compared, the best one among them
HALF = 0.5  # share of the best mu below which no other grasp is chosen
WEAK, TIE = 0.5, 0.95  # remaining share of mu below which a grasp is weak; share of mu from which a stronger one wins
APART = 0.1  # over the body's size: Hausdorff distance of contacts above which grasps are distinct


def chosen(bench: Workbench, best: StartGrasp, results: Sequence[StartResult], stop: Stop) -> StartGrasp:
    """Return the start selected as the answer, with its robustness where it was computed.

    That is the best one, unless it is fragile: then the first in the order of mu that is not, that has at least half
    its mu and leaves more at its worst placement. One that is not fragile, but keeps less than half of its mu, loses so
    to one with 0.95 of it. Two others are looked at. Of a hand with joints only starts count
    whose contacts can press against each other, as long as one of them has at least half the best one's mu: others hold
    the task only while it pushes into the fingers.

    Parameters
    ----------
    bench : Workbench
    best : StartGrasp
        With the best mu.
    results : sequence of StartResult
        All of them.
    stop : Stop
    """
    with one_thread():
        best, results = _pressing(bench, best, results)
        first = _looked_at(bench, best)
        if first.robust is None or first.robust.share(first.record.mu) >= WEAK:
            return first
        share = HALF if first.robust.is_fragile(first.record.mu) else TIE
        for other in _others(bench, best, results, share):
            if stop.requested():
                break
            found = _looked_at(bench, other)
            if found.robust is None or found.robust.is_fragile(found.record.mu):
                continue
            if found.robust.mu.lower > first.robust.mu.upper:
                return found
    return first


def _pressing(
    bench: Workbench, best: StartGrasp, results: Sequence[StartResult]
) -> tuple[StartGrasp, Sequence[StartResult]]:
    """Return the best start whose contacts can press against each other, and all such; the arguments if none can."""
    hand = bench.problem.hand
    if not isinstance(hand, PosedHand) or not hand.loaded_joints or can_press(best.found.grasp):
        return best, results
    least = HALF * best.record.mu.upper
    good = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.mu.lower >= least]
    able = [r for r in good if can_press(r.found.grasp)]
    first = best_of(able)
    return (best, results) if first is None else (first, able)


def _looked_at(bench: Workbench, start: StartGrasp) -> StartGrasp:
    """Return a start with its robustness; unchanged where that fails numerically."""
    try:
        return replace(start, robust=robustness(bench, start.found.placed, start.found.grasp))
    except (RuntimeError, ArithmeticError, ValueError):
        return start


def _others(bench: Workbench, best: StartGrasp, results: Sequence[StartResult], share: float) -> Iterator[StartGrasp]:
    """Yield the next best starts with distinct grasps of at least this share of mu, best first."""
    least, taken = share * best.record.mu.lower, [best]
    solved = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.mu.lower >= least]
    for start in sorted(solved, key=lambda r: (-r.record.mu.upper, r.record.index)):
        if len(taken) < MOST and all(_apart(start, other) > APART * bench.scaling.length for other in taken):
            taken.append(start)
            yield start


def _apart(a: StartGrasp, b: StartGrasp) -> float:
    """Return the Hausdorff distance between the contacts of two grasps, metres."""
    p, q = a.found.grasp.points, b.found.grasp.points
    distances = np.linalg.norm(p[:, None] - q[None], axis=2)
    return float(max(np.max(np.min(distances, axis=1)), np.max(np.min(distances, axis=0))))
