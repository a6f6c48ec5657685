"""A grasp whose hand has its joints away from their limits, near one that was found, where that costs little mu.

The ascent goes with the whole ranges first: narrow ones would keep starts from grasps. Then once more from its end,
with the ranges narrower by the joints' margins: joints go inside, contacts and palm follow until all fingers touch, and
mu rises again from there. Where that is not to be had, or costs too much, some joints keep their whole range.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.hands import URDFHand
from nlpgrasp.solution.joint_room import JointRoom
from nlpgrasp.solve.after.robust import robustness
from nlpgrasp.solve.posture.effort import worst_share
from nlpgrasp.solve.posture.margins import Margins
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.touch import TOUCHING, touching
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread

PRESSING = 1.01  # times its margin: a joint that is nearer than that would go on, if it might
RESERVE = 0.05  # of the efforts: what a squeeze has to take less of them, to count more than mu within the price
ROOM = "then with room for the joints"  # message of a start
Chosen = NDArray[np.bool_]


def with_room(bench: Workbench, best: StartGrasp, stop: Stop) -> StartGrasp:
    """Return a grasp with as many joints away from their limits as the price allows, or the grasp itself.

    The result says what room its joints have, with a hand that has links; other grasps come back as they are.

    Parameters
    ----------
    bench : Workbench
    best : StartGrasp
        The answer, found with the whole ranges.
    stop : Stop
    """
    hand, margin = bench.problem.hand, bench.options.joint_margin
    if not isinstance(hand, URDFHand) or margin == 0.0:
        return best
    with one_thread():
        posture = _Posture(bench, best, Margins.of(hand, margin), stop)
        try:
            return posture.found()
        except (RuntimeError, ArithmeticError, ValueError):
            return posture.told(best)


class _Posture:
    """A grasp, and what its joints lack."""

    def __init__(self, bench: Workbench, best: StartGrasp, margins: Margins, stop: Stop) -> None:
        self.bench, self.best, self.margins, self.stop = bench, best, margins, stop
        self.lacking = self._lacking(best)

    def found(self) -> StartGrasp:
        """Return the grasp with most joints inside their margins that keeps the price."""
        for ended in self._tries() if self.lacking.any() else ():
            better = [self._measured(end) for end in ended if self._is_better(end)]
            kept = [end for end in better if not self._is_frail(end)]
            if kept:
                return self.told(self._chosen(kept))
        return self.told(self.best)

    def told(self, end: StartGrasp) -> StartGrasp:
        """Return a grasp that says what room its joints have, as the end of the start that is the answer."""
        best, names, options = self.best, self.margins.names, self.bench.options
        room = JointRoom(
            options.joint_margin,
            dict(zip(names, self.margins.wanted.tolist(), strict=True)),
            self.margins.left_by_name(end.found.placed.hand["joints"]),
            options.room_price,
            best.record.mu,
            end.record.mu,
        )
        if end is best:
            return replace(best, room=room)
        record = replace(
            best.record,
            faces=end.record.faces,
            mu=end.record.mu,
            violation=end.record.violation,
            iterations=best.record.iterations + end.record.iterations,
            seconds={**best.record.seconds, "room": sum(end.record.seconds.values())},
            message=", ".join(part for part in (best.record.message, ROOM) if part),
        )
        return replace(end, record=record, spent=best.spent + end.spent, ascended=best.ascended, room=room)

    def _tries(self) -> Iterator[list[StartGrasp]]:
        """Yield where ascents end: with all margins, then with those that can be had or that cost little."""
        chosen, start = np.ones(len(self.lacking), dtype=bool), self.best.found.placed
        placed = self._touching(chosen, start)
        if placed is None:
            chosen, placed = self._one_by_one()
        else:
            ended = self._ended(chosen, placed)
            yield ended
            if not ended:
                return
            room = self.margins.left(ended[-1].found.placed.hand["joints"])
            chosen = ~(self.lacking & (room <= PRESSING * self.margins.wanted))
            placed = self._touching(chosen, start)
        if placed is not None and np.any(chosen & self.lacking) and not self.stop.requested():
            yield self._ended(chosen, placed)

    def _one_by_one(self) -> tuple[Chosen, Placed]:
        """Return which joints can be inside their margins together, taken in turn, and the hand where they are."""
        chosen, here = ~self.lacking, self.best.found.placed
        room = self.margins.left(here.hand["joints"])
        for j in np.argsort(-room / self.margins.wanted, kind="stable").tolist():
            if self.lacking[j]:
                more = chosen | (np.arange(len(chosen)) == j)
                placed = self._touching(more, here)
                if placed is not None:
                    chosen, here = more, placed
        return chosen, here

    def _touching(self, chosen: Chosen, start: Placed) -> Placed | None:
        """Return contacts and hand moved until all touch, with the joints chosen inside; None where they do not."""
        limits = self.margins.narrowed(chosen)
        hand = {**start.hand, "joints": np.clip(start.hand["joints"], limits[0], limits[1])}
        bench = self.bench.with_joints(limits)
        placed, left = touching(bench, replace(start, hand=hand))
        return bench.snapped(placed) if left <= TOUCHING else None

    def _ended(self, chosen: Chosen, placed: Placed) -> list[StartGrasp]:
        """Return the grasp there, and the end of an ascent from it, with the joints chosen inside."""
        bench = self.bench.with_joints(self.margins.narrowed(chosen))
        ends = run_given(bench, Given(placed), self.best.record.index, self.stop)
        return [end for end in ends if isinstance(end, StartGrasp) and end.solved]

    def _is_better(self, end: StartGrasp) -> bool:
        """Return whether fewer joints are near a limit and the price is kept."""
        least, known, there = 1.0 - self.bench.options.room_price, self.best.record.mu, end.record.mu
        if there.lower < least * known.lower or there.upper < least * known.upper:
            return False
        return self._near(end) < int(np.sum(self.lacking))

    def _measured(self, end: StartGrasp) -> StartGrasp:
        """Return an end with its robustness, where that of the answer is known."""
        if self.best.robust is None:
            return end
        return replace(end, robust=robustness(self.bench, end.found.placed, end.found.grasp))

    def _is_frail(self, end: StartGrasp) -> bool:
        """Return whether a grasp is fragile in place of one that is not."""
        old, new = self.best.robust, end.robust
        if old is None or new is None or old.is_fragile(self.best.record.mu):
            return False
        return new.is_fragile(end.record.mu)

    def _chosen(self, kept: list[StartGrasp]) -> StartGrasp:
        """Return the one with fewest joints near a limit; of several the one with most mu, or far less effort."""
        near = min(self._near(end) for end in kept)
        best, *rest = sorted((end for end in kept if self._near(end) == near), key=lambda end: -end.record.mu.lower)
        for other in rest:
            efforts = [worst_share(self.bench.hand_points.posed_hand, end.found) for end in (best, other)]
            if efforts[1] <= efforts[0] - RESERVE:
                best = other
        return best

    def _near(self, end: StartGrasp) -> int:
        return int(np.sum(self._lacking(end)))

    def _lacking(self, end: StartGrasp) -> Chosen:
        return self.margins.lacking(end.found.placed.hand["joints"])
