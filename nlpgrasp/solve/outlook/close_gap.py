"""Starts and tree together, until a grasp is proved to be close to the best possible."""

from __future__ import annotations

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.answer import best_of
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.start.result import StartResult
from nlpgrasp.solve.start.run import with_hand
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.programs import follows_contacts
from nlpgrasp.solve.workers.pool import Runner

STRIDE = 1000  # nodes between two looks at what the tree has met
BETTER = 1e-3  # relative: by how much a grasp of the tree has to seem better than the best start
TRIED = 3  # of the tree's grasps at a time


def close_gap(runner: Runner, results: list[StartResult], gap: float, stop: Stop) -> None:
    """Search all placements until the best grasp is within a gap of the bound, or a stop; add what starts it leads to.

    Parameters
    ----------
    runner : Runner
    results : list of StartResult
        Of the starts so far; grows by those that begin from grasps of the tree.
    gap : float
        Relative.
    stop : Stop
    """
    seen = runner.outlook(stop)
    offered: list[Placed] = []
    while seen is not None and not stop.requested():
        best = best_of(results)
        known = 0.0 if best is None else best.record.mu.lower
        seen.expect(known)
        if seen.upper <= known * (1.0 + gap):
            return
        worth = seen.placements(TRIED, (1.0 + BETTER) * known) if follows_contacts(runner.problem) else []
        new = [placed for placed in worth if not any(placed is other for other in offered)]
        if not new and seen.searched:
            return
        for placed in new:
            index = max((r.record.index for r in results), default=-1) + 1
            results += run_given(runner.bench, Given(with_hand(runner.bench, placed)), index, stop)
        offered += new
        if not new:
            seen.look(STRIDE, stop)
