"""The exchange: contacts, and hand, improved until the model promises nothing more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.ascend import SPAN, Rules, ascend
from nlpgrasp.solve.ascent.cuts import with_known
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.ascent.steps.registry import model_of
from nlpgrasp.solve.ascent.weakest import Weakest, disproved, weakest_at
from nlpgrasp.solve.workbench.workbench import Workbench


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
        there = exchange(plain, replace(state, history=[]), rng, stop)
        state = replace(state, placed=there.placed, effort=there.effort, multipliers=there.multipliers)
    return exchange(bench, state, rng, stop)


def exchange(
    bench: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop, rules: Rules | None = None
) -> AscentState:
    """Improve a state in place until the model promises nothing more, the rounds are used up, or a stop.

    Descents may flatter where it ends: as long as a polytope finds a direction that they missed, the ascent goes on
    from there with that direction.

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
    weakest: Weakest | None = weakest_at(bench, state.placed, rng)
    while weakest is not None:
        state.cuts, state.value = with_known(state.cuts, weakest.directions, bench.problem.task), weakest.value
        for turn in ascend(bench, state, model, rules, rng, stop):
            if turn.step.promised < rules.least_gain * state.value:
                break
            if rules.slowest > 0.0 and _gain(state) < rules.slowest:
                break
        weakest = disproved(bench, state.placed, state.value) if state.rounds < rules.rounds else None
    state.remember()
    return state


def _gain(state: AscentState) -> float:
    """Return the relative gain over the latest rounds."""
    if len(state.history) <= SPAN:
        return np.inf
    return state.value / max(state.history[-1 - SPAN], 1e-300) - 1.0
