"""A local optimum that is followed: looked at and slid by shorter descents than a solve's; the certificate decides."""

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
CUTS = 48  # of the exchange's program: a third of a solve's, in a third of the time
SEEN = 24  # of a branch's directions, those found last, tell how good others can be at most
GAIN = 2e-3  # relative: a slide ends where rounds gain less
LAP = 6  # rounds of a slide from afar at a time
NEAR_ROUNDS = 8  # of a branch that was at its best: the task changes a little, and so do contacts
NEVER = -1


@dataclass
class Branch(AscentState):
    """A local optimum that is followed.

    Parameters
    ----------
    placed, value, cuts, multipliers, effort, history
        As for ``AscentState``.
    settled : int
        The step at which it was slid to its best last.
    """

    settled: int = NEVER


def look(bench: Workbench, state: Branch, rng: np.random.Generator) -> None:
    """Compute quality and weakest directions of a branch for the task at hand."""
    task, none = bench.problem.task, np.zeros((0, bench.problem.dimension))
    weakest = weakest_at(bench, state.placed, rng, with_known(state.cuts, none, task), LOOSE)
    state.value, state.cuts = weakest.value, with_known(state.cuts, weakest.directions, task)


def learn(bench: Workbench, state: Branch) -> bool:
    """Add the directions in which a branch is weaker than descents found it; return whether there are any."""
    found, _ = disproved(bench, state.placed, state.value)
    if found is None:
        return False
    state.cuts, state.value = with_new(bench, state.cuts, found.directions), found.value
    return True


def at_most(bench: Workbench, states: Sequence[Branch]) -> FloatArray:
    """Return what the quality of each branch is at most for the task at hand, (n,).

    It is the least ratio of supports (3.4-3) along the directions in which any of them was weak.
    """
    result = np.full(len(states), np.inf)
    known = [state.cuts[-SEEN:] for state in states if len(state.cuts)]
    if known:
        y = with_known(np.concatenate(known), np.zeros((0, bench.problem.dimension)), bench.problem.task)
        for i, state in enumerate(states):
            result[i] = np.min(bench.wrench_set(state.placed).support(y)[0], initial=np.inf)
    return result


def slide(bench: Workbench, state: Branch, step: int) -> bool:
    """Slide a branch that was looked at towards its best; return whether it got there, in ``step`` of the path."""
    found = refine(bench, state.placed, Stop(), LAP if state.settled == NEVER else NEAR_ROUNDS, GAIN)
    if found.point.value > state.value:
        state.accept(found.point.placed, found.point.value, found.multipliers)
    state.cuts, state.effort = with_new(bench, state.cuts, found.point.cuts), state.effort + found.effort
    if found.settled:
        state.settled = step
    return found.settled
