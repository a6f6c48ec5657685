"""The ascent: mu itself, maximised with cutting planes in a trust region.

The support inequalities (Li and Sastry 1986, equation 3.4-3) hold in the directions where the current grasp is weakest;
a step moves the contacts, which then are weakest elsewhere, and those directions join the cuts. Early cuts are too
loose to be trusted far from where they were found, hence the trust region on the positions. What proposes the steps is
a model: the nonlinear program itself, or its linearisation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.ascent.cuts import most_relevant, with_new
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.ascent.weakest import QUICK, Descents, Weakest, weakest_at
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

SPAN = 4  # rounds over which gains are looked at
HALF, TENTH = 0.5, 0.1  # shares of the promised gain that make a step a good one, and a fair one


@dataclass(frozen=True)
class Rules:
    """How an ascent goes about it; radii over the body's size.

    Parameters
    ----------
    rounds : int
        At most.
    radius, last_radius, most_radius : float
        Trust region at first, where it ends, and at most.
    good, poor : float
        Factor on the radius after a step that gains more than half of what the model promised, and after one that gains
        less than a tenth of it.
    worse, refused : float
        Factor after a trial that gains nothing, and where there is none that keeps the constraints.
    allowed : float
        Violation of a trial, relative to the rows' scales, that still counts as keeping them.
    least_gain : float
        Relative: the ascent ends where the model promises less.
    slowest : float
        Relative gain over ``SPAN`` rounds, below which the exchange ends.
    looks_back : bool
        Whether directions found at a trial may lower the value of where the ascent stands.
    untried : float
        Relative: where the model promises less the ascent ends without a trial. Not by default: near an optimum a model
        that looks back promises a little less than nothing, and a trial tells that the ascent has settled.
    descents : Descents
        How thoroughly trials are searched for weak directions.
    """

    rounds: int
    radius: float
    last_radius: float
    most_radius: float = np.inf
    good: float = 1.0
    poor: float = 1.0
    worse: float = 0.4
    refused: float = 0.4
    allowed: float = FEASIBLE
    least_gain: float = 0.0
    slowest: float = 0.0
    looks_back: bool = False
    untried: float = -np.inf
    descents: Descents = QUICK

    def growth(self, gained: float, promised: float) -> float:
        """Return the factor on the radius after a step that gained something."""
        return self.good if gained > HALF * promised else 1.0 if gained > TENTH * promised else self.poor


@dataclass(frozen=True)
class Step:
    """What a model proposes.

    Parameters
    ----------
    placed : Placed
    promised : float
        The rise of mu that the model sees.
    multipliers : (rows,) array
        Of the rows of constraints and hand, solver units.
    effort : Effort
    support : (m,) array
        Multipliers of the cuts, at least zero up to rounding; empty from a model that does not tell.
    """

    placed: Placed
    promised: float
    multipliers: FloatArray
    effort: Effort
    support: FloatArray = field(default_factory=lambda: np.zeros(0))


class Model(Protocol):
    """What proposes the steps of an ascent."""

    def step(self, state: AscentState, cuts: FloatArray, radius: float) -> Step | None:
        """Return a step from where the ascent stands, or None where the model finds none.

        Parameters
        ----------
        state : AscentState
        cuts : (m, d) array
            Directions with ``phi_A = 1``.
        radius : float
            How far positions may go, over the body's size.
        """


@dataclass(frozen=True)
class Round:
    """A round of an ascent whose trial keeps the constraints.

    Parameters
    ----------
    step : Step
    trial : Weakest
        What the search finds at the trial.
    before : float
        The value that the trial is compared with.
    cuts : (m, d) array
        What the model knew.
    """

    step: Step
    trial: Weakest
    before: float
    cuts: FloatArray


def ascend(
    bench: Workbench, state: AscentState, model: Model, rules: Rules, rng: np.random.Generator, stop: Stop
) -> Iterator[Round]:
    """Improve a state in place, and yield each round: who asks for them decides when the ascent has settled.

    Ends by itself when the rounds are used up, the trust region has shrunk away, no direction is known, the model
    promises too little for a trial, or a stop.
    """
    radius = rules.radius
    while state.rounds < rules.rounds and radius > rules.last_radius and len(state.cuts) and not stop.requested():
        state.begin_round()
        state.cuts = cuts = most_relevant(bench, state.placed, state.cuts)
        step = model.step(state, cuts, radius)
        if step is not None and step.promised < rules.untried * state.value:
            state.effort += step.effort
            return
        trial = None if step is None else _evaluated(bench, step, cuts, rng, rules)
        if step is not None:
            state.effort += step.effort
        if step is None or trial is None:
            radius *= rules.refused
            continue
        if rules.looks_back:
            seen = bench.wrench_set(state.placed).support(trial.directions)[0]
            state.value = min(state.value, float(np.min(seen, initial=np.inf)))
        before = state.value
        state.cuts = with_new(bench, cuts, trial.directions)
        if trial.value > before:
            state.accept(step.placed, trial.value, step.multipliers)
            radius = min(radius * rules.growth(trial.value - before, step.promised), rules.most_radius)
        else:
            radius *= rules.worse
        yield Round(step, trial, before, cuts)


def _evaluated(
    bench: Workbench, step: Step, cuts: FloatArray, rng: np.random.Generator, rules: Rules
) -> Weakest | None:
    """Return the weakest directions at a step's end, or None where it breaks a constraint."""
    if bench.violation(step.placed) > rules.allowed:
        return None
    return weakest_at(bench, step.placed, rng, cuts, rules.descents)
