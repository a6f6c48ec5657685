"""One start: candidates, first program, exchange, surface, certificate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.contacts.direction import AlongNormalError
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.records import Origin, StartRecord, Status
from nlpgrasp.solve.after.robust_ascent import steady
from nlpgrasp.solve.ascent.exchange import exchange, exchange_in_turn, exchange_rules, exchange_under_l2
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.start.first_program import FirstResult, solve_first
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.start.screen import candidates
from nlpgrasp.solve.surface.facing import has_jaws_on_mesh
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.put import put_on_body
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.solve.workers.one_thread import one_thread

SLOWEST = 0.01  # relative gain over some rounds, below which the exchange from a grasp that was climbed to ends
SLOWEST_BEFORE = 0.03  # the same where contacts climb over the mesh itself afterwards
MOST_TOUCHING = 2  # attempts of a start whose hand touches, before it ends


def run_start(bench: Workbench, index: int, seed: int, stop: Stop, known: Placed | None = None) -> StartResult:
    """Run start ``index``, from a placement where one is known to be good; it depends on that, seed and index only.

    Never raises for a numerical failure: the record carries the status and the message. Bad input does raise.
    Linear algebra runs on one thread, so that rounding does not depend on how many cores there are.
    """
    clock = Clock()
    with one_thread():
        try:
            found = _best_attempt(_Attempts(bench, index, np.random.default_rng([seed, index]), stop, clock, known))
        except (RuntimeError, np.linalg.LinAlgError, AlongNormalError) as error:
            text = f"{type(error).__name__}: {error}"
            return StartResult(StartRecord(index, Status.FAILED, seconds=clock.seconds, message=text))
    return replace(found, record=replace(found.record, seconds=clock.seconds))


class _Attempts:
    """What a start makes of its candidates, one after another."""

    def __init__(
        self,
        bench: Workbench,
        index: int,
        rng: np.random.Generator,
        stop: Stop,
        clock: Clock,
        known: Placed | None,
    ) -> None:
        self.bench, self.index, self.rng, self.stop, self.clock = bench, index, rng, stop, clock
        self._known = None if known is None else with_hand(bench, known)

    def __iter__(self) -> Iterator[StartGrasp]:
        """Yield the grasp from the known placement, then one for each first program that ends with one."""
        bench, known = self.bench, self._known
        facing = known is not None and has_jaws_on_mesh(bench.problem)
        if known is not None and (facing or bench.violation(known) <= FEASIBLE):
            state = AscentState(known, multipliers=np.zeros(len(bench.rows.named)))
            origin = Origin.FACING if facing else Origin.BOUND
            yield self._finished(FirstResult(state, np.nan, np.nan, origin.value, origin), self.rng)
            known = None
        begins = bench if self._plain is None else self._plain
        drawn = chain([] if known is None else [known], candidates(begins, self.rng, self.stop))
        self.clock.mark("screen")
        while True:
            rng = self.rng if bench.follows_contacts else self.rng.spawn(1)[0]  # whatever other attempts use up
            first = solve_first(begins, drawn, rng)
            self.clock.mark("vertex")
            if first is None:
                return
            yield self._finished(first, rng)

    @property
    def wanted(self) -> int:
        """How many grasps there have to be: one, but two of a hand whose ascents begin under the paper's budget."""
        return 1 if self._plain is None else 2

    @property
    def _plain(self) -> Workbench | None:
        """The workbench under the paper's budget, where a hand's candidates are compared on it; else None.

        So a start begins as it would under that budget, and its answer is no worse under its own than what the other
        budget leads to.
        """
        return None if self.bench.follows_contacts else self.bench.under_l2

    @property
    def _under_l2_first(self) -> bool:
        """Whether this start, of a hand that follows its contacts or none, goes up under the paper's budget first.

        Every other does of those that draw for themselves.
        """
        return self.index % 2 == 1 and self._known is None

    def _finished(self, first: FirstResult, rng: np.random.Generator) -> StartGrasp:
        """Refine what the first program found, put it onto the body and certify it: the best of what that leads to."""
        each = [self._told(first, *end, rng) for end in self._ascended(first, rng)]
        return max(each, key=lambda grasp: (grasp.solved, grasp.rank.lower))

    def _ascended(self, first: FirstResult, rng: np.random.Generator) -> list[tuple[Workbench, AscentState]]:
        """Return where ascents end, each with the workbench of the budget it was under."""
        bench, state, stop = self.bench, first.state, self.stop
        if not bench.options.exchange or _is_on_mesh(bench, first):
            return [(bench, state)]
        if first.origin is Origin.FACING:
            return [
                (bench, state),
                (bench, exchange(bench, replace(state, placed=bench.snapped(state.placed)), rng, stop)),
            ]
        slowest = _slowest(bench, first)
        if slowest > 0.0:
            rules = replace(exchange_rules(bench), slowest=slowest)
            return [(bench, exchange(bench, state, rng, stop, rules))]
        if self._plain is not None:
            before = exchange_under_l2(self._plain, state, rng, stop)
            after = exchange(bench, replace(before, history=[]), rng, stop)
            # on a mesh the better one before may be the worse one after it was put there
            return [(bench, after)] + ([(self._plain, before)] if isinstance(bench.problem.body, Mesh) else [])
        improve = exchange_in_turn if self._under_l2_first else exchange
        return [(bench, improve(bench, state, rng, stop))]

    def _told(self, first: FirstResult, under: Workbench, state: AscentState, rng: np.random.Generator) -> StartGrasp:
        """Put the end of an ascent onto the body, and certify it."""
        bench = self.bench
        self.clock.mark("exchange")
        found = put_on_body(under, state, rng, self.stop, _is_on_mesh(bench, first))
        self.clock.mark("mesh")
        robust = None
        if bench.options.maximise_robust:
            found, robust = steady(bench, found)
            self.clock.mark("robust")
        bounds = _certified(bench, found, state, self.stop.certificate_deadline())
        self.clock.mark("certificate")
        end = StartGrasp.of(bench, self.index, found, bounds, state, first.message, origin=first.origin, robust=robust)
        self.clock.mark("link depth")
        return end


def _slowest(bench: Workbench, first: FirstResult) -> float:
    """Return the relative gain over some rounds below which the exchange from a state ends; 0 where there is none."""
    if not bench.follows_contacts:
        return 0.0
    if _climbs_freely(bench):
        return SLOWEST_BEFORE
    return SLOWEST if first.origin is Origin.BOUND else 0.0


def _is_on_mesh(bench: Workbench, first: FirstResult) -> bool:
    """Return whether a start begins from a grasp that was found on the mesh itself.

    The ascent on the smooth surface would only lead away from it; a model of it that is asked for by name is used.
    """
    return first.origin is Origin.BOUND and _climbs_freely(bench) and not isinstance(bench.options.exchange, str)


def _climbs_freely(bench: Workbench) -> bool:
    """Return whether contacts climb over the mesh itself, one by one."""
    return bench.mesh_climb is not None and not bench.mesh_climb.coupled


def with_hand(bench: Workbench, placed: Placed) -> Placed:
    """Return a placement with the values that a hand whose variables follow from the contacts has there."""
    hand = bench.hand_points.start(placed.points[None], bench.inward_normals(placed)[None])
    return Placed(placed.faces, placed.points, {name: value[0] for name, value in hand.items()})


def _certified(bench: Workbench, found: OnBody, state: AscentState, deadline: float | None) -> Bounds:
    """Return the certificate of a grasp; it goes on from the one that the ascent began, where that is of this grasp."""
    rtol, budget, begun = bench.options.rtol, bench.budget(found.placed), state.begun
    if begun is not None and begun.is_of(found.grasp, budget):
        return begun.bounds(rtol, deadline)
    return mu(found.grasp, bench.problem.task, rtol, force_budget=budget, deadline=deadline)


def _best_attempt(attempts: _Attempts) -> StartGrasp:
    """Return the best of the first attempts that exert the task and keep the constraints.

    Without any, the best whose links are inside something, of which there are few; without these, the first. Its effort
    is that of all attempts.
    """
    each = iter(attempts)
    first = following = next(each)
    effort = first.effort
    solved, touching = list[StartGrasp](), list[StartGrasp]()
    while True:
        solved += [following] if following.solved else []
        touching += [following] if following.record.status is Status.TOUCHES else []
        if len(solved) >= attempts.wanted or len(touching) >= MOST_TOUCHING or attempts.stop.requested():
            break
        found = next(each, None)
        if found is None:
            break
        following = found
        effort += found.effort
    best = max(solved or touching or [first], key=lambda grasp: grasp.rank.lower)
    return replace(best, spent=effort)
