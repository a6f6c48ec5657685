"""The exchange: contacts, and hand, improved until the model promises nothing more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.solve.ascent.ascend import Model, Rules, Step, ascend
from nlpgrasp.solve.ascent.cuts import with_known
from nlpgrasp.solve.ascent.linear import LinearModel
from nlpgrasp.solve.ascent.nonlinear import NonlinearModel
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.stop import Stop

NONLINEAR = Rules(rounds=40, radius=0.15, last_radius=1e-4, good=1.5, poor=0.6, least_gain=1e-4)
LINEAR = Rules(rounds=40, radius=0.1, last_radius=1e-3, most_radius=0.3, good=1.6, poor=0.5, least_gain=1e-3)


def exchange_rules(bench: Workbench) -> Rules:
    """Return the rules of the exchange that suits the problem."""
    rules = LINEAR if bench.exchange.linearises else NONLINEAR
    return replace(rules, rounds=bench.options.exchange_rounds)


def exchange(
    bench: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop, rules: Rules | None = None
) -> AscentState:
    """Improve a state in place until the model promises nothing more, the rounds are used up, or a stop.

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
    model: Model[Step] = LinearModel(bench) if bench.exchange.linearises else NonlinearModel(bench)
    weakest = weakest_at(bench, state.placed, rng)
    state.cuts, state.value = with_known(state.cuts, weakest.directions, bench.problem.task), weakest.value
    for turn in ascend(bench, state, model, rules, rng, stop):
        if turn.step.promised < rules.least_gain * state.value:
            break
    state.remember()
    return state
