"""What is worth knowing once all starts are done: prices of limits, the pregrasp, or why there is no grasp."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from nlpgrasp.common.shown.drawing import Drawing
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.hands import URDFHand
from nlpgrasp.solution.findings import Robustness, WhyNot
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solve.after.drawing import drawing_of
from nlpgrasp.solve.after.pregrasp import Pregrasp, pregrasp
from nlpgrasp.solve.after.prices import shadow_prices
from nlpgrasp.solve.after.robust import robustness
from nlpgrasp.solve.after.why_not import why_not
from nlpgrasp.solve.phases.keyframes import keyframes
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.surface.link_depth import LinkDepth, link_depth
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread

T = TypeVar("T")


@dataclass(frozen=True)
class Aftermath:
    """What was found out after the starts.

    Parameters
    ----------
    prices : tuple of ShadowPrice
    pregrasp : Pregrasp or None
        With a hand that has a pose.
    phases : mapping or None
        With a hand that has links: what the file says of its phases up to the grasp.
    why_not : WhyNot or None
        Without a grasp.
    link_depth : LinkDepth or None
        With a hand that has links.
    robust : Robustness or None
    drawing : Drawing or None
    seconds : dict
        Wall time of each of these.
    """

    prices: tuple[ShadowPrice, ...] = ()
    pregrasp: Pregrasp | None = None
    why_not: WhyNot | None = None
    link_depth: LinkDepth | None = None
    robust: Robustness | None = None
    drawing: Drawing | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    phases: Json | None = None


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
        before = before_grasp(bench, best.found, clock)
        told = extras(bench, best, stop, clock) if bench.options.extras else Aftermath(robust=best.robust)
        return replace(told, pregrasp=before.pregrasp, phases=before.phases, seconds=clock.seconds)


def before_grasp(bench: Workbench, found: OnBody, clock: Clock) -> Aftermath:
    """Return the pregrasp and the phases of a grasp, with a hand that has them."""
    hand, opened, phases = bench.problem.hand, None, None
    if not bench.follows_contacts:
        opened = attempted(lambda: pregrasp(bench, found, bench.options.pregrasp_clearance))
        clock.mark("pregrasp")
    if isinstance(hand, URDFHand):
        linked, grasp = hand, found.placed.hand
        phases = attempted(lambda: keyframes(bench.problem, linked, grasp, None if opened is None else opened.hand))
        clock.mark("phases")
    return Aftermath(pregrasp=opened, phases=phases)


def extras(bench: Workbench, best: StartGrasp, stop: Stop, clock: Clock) -> Aftermath:
    """Return what a grasp is not the worse for without: depth of the links, prices, robustness, drawing."""
    hand, found = bench.problem.hand, best.found
    depth, prices = None, None
    if isinstance(hand, URDFHand):
        linked = hand
        depth = attempted(lambda: link_depth(bench.problem.body, linked, found.placed.hand))
        clock.mark("link depth")
    if bench.options.shadow_prices:
        prices = attempted(lambda: shadow_prices(bench, best, stop))
        clock.mark("prices")
    robust = best.robust or attempted(lambda: robustness(bench, found.placed, found.grasp))
    clock.mark("robustness")
    drawing = attempted(lambda: drawing_of(bench.problem.body, hand, found.placed.hand))
    clock.mark("drawing")
    return Aftermath(prices or (), None, None, depth, robust, drawing)


def attempted(work: Callable[[], T]) -> T | None:
    """Return what the work returns, or None where it fails numerically."""
    try:
        return work()
    except (RuntimeError, ArithmeticError, ValueError):
        return None
