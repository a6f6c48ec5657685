"""What follows the starts: the hand's way in, or without a grasp the diagnosis why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.solution.findings import WhyNot
from nlpgrasp.solve.after.way_in import approached, attempted
from nlpgrasp.solve.after.why_not import why_not
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread


@dataclass(frozen=True)
class Aftermath:
    """What was found out after the starts.

    Parameters
    ----------
    hand : mapping or None
        The hand with its way in, as files state it, where the start does not say it itself.
    why_not : WhyNot or None
        Without a grasp.
    seconds : dict
        Wall time of each of these.
    """

    hand: Json | None = None
    why_not: WhyNot | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)


def look_back(
    bench: Workbench, best: StartGrasp | None, results: Sequence[StartResult], seed: int, stop: Stop
) -> Aftermath:
    """Return the hand of the best start with its way in, or without one the diagnosis.

    A numerical failure here leaves a part out: it never costs the grasp.
    """
    clock = Clock()
    with one_thread():
        if best is None:
            found_out = attempted(lambda: why_not(bench, results, seed, stop))
            clock.mark("why not")
            return Aftermath(why_not=found_out, seconds=clock.seconds)
        return Aftermath(hand=best.hand or approached(bench, best, clock).hand, seconds=clock.seconds)
