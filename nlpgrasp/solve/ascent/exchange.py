"""The exchange: contacts, and hand, improved until the model promises nothing more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.ascend import SPAN, Rules, ascend
from nlpgrasp.solve.ascent.cuts import with_known, with_new
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.ascent.steps.registry import model_of
from nlpgrasp.solve.ascent.weakest import looked_at, missed, weakest_at
from nlpgrasp.solve.workbench.workbench import Workbench

LAP = 10  # rounds between two looks at what descents may have missed


def exchange_rules(bench: Workbench) -> Rules:
    """Return the rules of the exchange's model, with the rounds that the options allow."""
    return replace(model_of(bench).rules, rounds=bench.options.exchange_rounds)


def exchange_in_turn(bench: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop) -> AscentState:
    """Improve a state under the paper's budget first, where the problem's is another, and then under its own.

    The support under the paper's budget, a root of a sum of squares over the contacts, is smooth where those of other
    budgets, a largest one or a sum, have edges: an ascent of theirs from afar ends at such an edge. What is found is
    a local optimum under the problem's own budget all the same: the second ascent decides (docs/architecture.md).
    """
    plain = bench.under_l2
    if plain is not None and not stop.requested():
        state = exchange_under_l2(plain, state, rng, stop)
    return exchange(bench, state, rng, stop)


def exchange_under_l2(plain: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop) -> AscentState:
    """Return where a state gets under the paper's budget, whose workbench is given: not its rounds, nor its cuts."""
    there = exchange(plain, replace(state, history=[]), rng, stop)
    return replace(
        state,
        placed=there.placed,
        value=there.value,
        effort=there.effort,
        multipliers=there.multipliers,
        history=[*state.history],
    )


def exchange(
    bench: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop, rules: Rules | None = None
) -> AscentState:
    """Improve a state in place until the model promises nothing more, the rounds are used up, or a stop.

    Descents may flatter: every few rounds, and where it ends, a polytope looks for directions that they missed, and
    the ascent goes on from the last state that was confirmed, with those directions.

    Parameters
    ----------
    bench : Workbench
    state : AscentState
        Its cuts may be those of another task.
    rng : numpy.random.Generator
    stop : Stop
    rules : Rules, optional
        In place of ``exchange_rules(bench)``.
    """
    rules = exchange_rules(bench) if rules is None else rules
    model = model_of(bench).make(bench)
    weakest = weakest_at(bench, state.placed, rng)
    state.cuts, state.value = with_known(state.cuts, weakest.directions, bench.problem.task), weakest.value
    sure = _Confirmed(bench, state)
    going = True
    while going:
        for turn in ascend(bench, state, model, rules, rng, stop):
            if turn.step.promised < rules.least_gain * state.value:
                break
            if rules.slowest > 0.0 and _gain(state) < rules.slowest:
                break
            sure.look_now_and_then()
        going = not sure.look() and state.rounds < rules.rounds
    state.remember()
    return state


class _Confirmed:
    """The last state of an ascent whose value a polytope confirmed.

    Parameters
    ----------
    bench : Workbench
    state : AscentState
        Where the ascent stands; put back, with directions that descents missed, where these make it the worse one.
    """

    def __init__(self, bench: Workbench, state: AscentState) -> None:
        self._bench, self._state, self._rounds = bench, state, state.rounds
        self._placed, self._value, self._multipliers = state.placed, -np.inf, state.multipliers
        self.look()

    def look_now_and_then(self) -> None:
        """Look again after some rounds."""
        if self._state.rounds - self._rounds >= LAP:
            self.look()

    def look(self) -> bool:
        """Confirm the state, or put it right; return whether it was confirmed."""
        state = self._state
        if state.placed is self._placed and state.value == self._value:
            return True  # it was looked at already
        begun = state.begun = looked_at(self._bench, state.placed, state.value)
        found = None if begun is None else missed(begun, state.value)
        if found is not None:
            state.cuts, state.value = with_new(self._bench, state.cuts, found.directions), found.value
            if found.value < self._value:
                state.accept(self._placed, self._value, self._multipliers)
        self._placed, self._value, self._multipliers = state.placed, state.value, state.multipliers
        self._rounds = state.rounds
        return found is None


def _gain(state: AscentState) -> float:
    """Return the relative gain over the latest rounds."""
    if len(state.history) <= SPAN:
        return np.inf
    return state.value / max(state.history[-1 - SPAN], 1e-300) - 1.0
