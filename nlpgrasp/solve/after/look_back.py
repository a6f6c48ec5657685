"""Analyses after all starts: prices of limits, robustness, the hand's way in; or why there is no grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from nlpgrasp.common.shown.drawing import Drawing
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.solution.findings import Robustness, WhyNot
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solve.after.drawing import drawing_of
from nlpgrasp.solve.after.prices import shadow_prices
from nlpgrasp.solve.after.robust import robustness
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
    prices : tuple of ShadowPrice
    hand : mapping or None
        The hand with its way in, as files state it, where the start does not say it itself.
    why_not : WhyNot or None
        Without a grasp.
    robust : Robustness or None
    drawing : Drawing or None
    seconds : dict
        Wall time of each of these.
    """

    prices: tuple[ShadowPrice, ...] = ()
    hand: Json | None = None
    why_not: WhyNot | None = None
    robust: Robustness | None = None
    drawing: Drawing | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)


def look_back(
    bench: Workbench, best: StartGrasp | None, results: Sequence[StartResult], seed: int, stop: Stop
) -> Aftermath:
    """Return prices and pregrasp of the best start, or without one the diagnosis.

    A numerical failure here leaves a part out: it never costs the grasp.
    """
    clock = Clock()
    with one_thread():
        if best is None:
            found_out = attempted(lambda: why_not(bench, results, seed, stop))
            clock.mark("why not")
            return Aftermath(why_not=found_out, seconds=clock.seconds)
        hand = best.hand or approached(bench, best, clock).hand
        told = extras(bench, best, stop, clock) if bench.options.extras else Aftermath(robust=best.robust)
        return replace(told, hand=hand, seconds=clock.seconds)


def extras(bench: Workbench, best: StartGrasp, stop: Stop, clock: Clock) -> Aftermath:
    """Return what a grasp is not the worse for without: prices, robustness, drawing."""
    hand, found, prices = bench.problem.hand, best.found, None
    if bench.options.shadow_prices:
        prices = attempted(lambda: shadow_prices(bench, best, stop))
        clock.mark("prices")
    robust = best.robust or attempted(lambda: robustness(bench, found.placed, found.grasp))
    clock.mark("robustness")
    drawing = attempted(lambda: drawing_of(bench.problem.body, hand, found.placed.hand))
    clock.mark("drawing")
    return Aftermath(prices or (), robust=robust, drawing=drawing)
