"""Refinement of a followed local optimum: shorter searches than a solve's, checked by certificates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.ascent.cuts import with_known, with_new
from nlpgrasp.solve.ascent.refine import refine
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.ascent.weakest import QUICK, disproved, weakest_at
from nlpgrasp.solve.workbench.workbench import Workbench

LOOSE = replace(QUICK, gap=0.01)
CUTS = 48  # most cuts of the refinement's program: a third of a solve's
SEEN = 24  # latest directions of a branch that bound other branches' quality
GAIN = 2e-3  # least relative gain of rounds of a refinement
LAP = 6  # rounds of a refinement of an unsettled branch
NEAR_ROUNDS = 8  # rounds of a refinement of a branch that was locally optimal before
NEVER = -1


@dataclass
class Branch(AscentState):
    """A followed local optimum.

    Parameters
    ----------
    placed, value, cuts, multipliers, effort, history
        As for ``AscentState``.
    settled : int
        The last step at which its refinement converged.
    """

    settled: int = NEVER


def look(bench: Workbench, state: Branch, rng: np.random.Generator) -> None:
    """Evaluate quality and weakest directions of a branch for the current task."""
    task, none = bench.problem.task, np.zeros((0, bench.problem.dimension))
    weakest = weakest_at(bench, state.placed, rng, with_known(state.cuts, none, task), LOOSE)
    state.value, state.cuts = weakest.value, with_known(state.cuts, weakest.directions, task)


def learn(bench: Workbench, state: Branch) -> bool:
    """Add the directions in which the certificate refutes a branch's estimated quality; return whether any exist."""
    found, _ = disproved(bench, state.placed, state.value)
    if found is None:
        return False
    state.cuts, state.value = with_new(bench, state.cuts, found.directions), found.value
    return True


def at_most(bench: Workbench, states: Sequence[Branch]) -> FloatArray:
    """Return upper bounds on the branches' qualities for the current task, (n,).

    They are the least ratios of supports (3.4-3) along weak directions of all branches.
    """
    result = np.full(len(states), np.inf)
    known = [state.cuts[-SEEN:] for state in states if len(state.cuts)]
    if known:
        y = with_known(np.concatenate(known), np.zeros((0, bench.problem.dimension)), bench.problem.task)
        for i, state in enumerate(states):
            result[i] = np.min(bench.wrench_set(state.placed).support(y)[0], initial=np.inf)
    return result


def slide(bench: Workbench, state: Branch, step: int) -> bool:
    """Refine a branch for the current task; return whether it converged, in ``step`` of the path."""
    found = refine(bench, state.placed, Stop(), LAP if state.settled == NEVER else NEAR_ROUNDS, GAIN)
    if found.point.value > state.value:
        state.accept(found.point.placed, found.point.value, found.multipliers)
    state.cuts, state.effort = with_new(bench, state.cuts, found.point.cuts), state.effort + found.effort
    if found.settled:
        state.settled = step
    return found.settled
