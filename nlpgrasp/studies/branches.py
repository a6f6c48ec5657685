"""Local optima of a task that changes, side by side: where sliding along no longer helps, another one takes over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solve.ascent.ascend import Rules
from nlpgrasp.solve.ascent.cuts import with_known
from nlpgrasp.solve.ascent.exchange import exchange, exchange_rules
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.ascent.weakest import AFTER_A_STEP, weakest_at
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.run import run_start
from nlpgrasp.solve.start.screen import draw_start
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

SAME = 0.02  # of the body's size: contacts this close, in whatever order, are the same grasp
SHARE = 0.13  # of the starts that cold solves of all steps would take look for branches, those of both ends at least
FOLLOWED = 10  # branches at most: the best at hand
HOPEFUL, REST = 0.9, 3  # another is improved from this share of the best's quality, and then rests for so many steps
NEAR_RADIUS, NEAR_GAIN, NEAR_ROUNDS = 0.05, 2e-3, 8  # of the exchange: the task changes a little, and so do contacts


@dataclass
class Branch(AscentState):
    """A local optimum that is followed.

    Parameters
    ----------
    placed, value, cuts, multipliers, effort, rounds, history
        As for ``AscentState``.
    improved : int
        The step at which it was slid to its best last.
    """

    improved: int = -REST


class Branches:
    """Local optima that are followed through tasks, each slid to where it is best for the task at hand.

    Parameters
    ----------
    benches : sequence of Workbench
        One a step of the path.
    starts : int
        Of a cold solve of one step.
    seed : int
    """

    def __init__(self, benches: Sequence[Workbench], starts: int, seed: int) -> None:
        self._starts, self._seed = starts, seed
        self.states: list[Branch] = []
        self._steps = 0
        for where in (0, len(benches) - 1):
            for number in range(starts):  # those of cold solves there
                self._begin(benches[where], number)
        more = int(np.ceil(SHARE * starts * len(benches))) - 2 * starts
        more = max(more, 0 if self.states else starts)  # tasks between may be easier than both ends
        between = np.linspace(0, len(benches) - 1, more + 2)[1:-1]
        for n, where in enumerate(np.round(between).astype(int).tolist()):
            self._begin(benches[where], starts + n)

    def _begin(self, bench: Workbench, number: int) -> None:
        """Add what a start finds."""
        found = run_start(bench, number, self._seed, Stop())
        if isinstance(found, StartGrasp) and found.solved:
            self.add(bench, found.found.placed)

    def add(self, bench: Workbench, placed: Placed) -> Branch:
        """Return the branch that contacts, and hand, are on; a new one where none is there."""
        there = self._there(bench, placed)
        if there is None:
            there = _branch(bench, placed)
            self.states.append(there)
        return there

    def _there(self, bench: Workbench, placed: Placed) -> Branch | None:
        size = SAME * bench.scaling.length
        near = (b for b in self.states if np.max(distances(placed.points, b.placed.points)) <= size)
        return next(near, None)

    def look(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Compute the quality of every branch for another task, and drop what has become the same; the best stay.

        The directions known of a branch say little of a task that has turned: they may not reach it at all. So each is
        looked at anew, and so is the best of some random placements, which joins where it is as good.
        """
        for state in self.states:
            _look(bench, state, rng)
        best = max((state.value for state in self.states), default=0.0)
        drawn = draw_start(bench, rng)[0]
        if bench.violation(drawn) <= FEASIBLE:
            fresh = _branch(bench, drawn)
            _look(bench, fresh, rng)
            if fresh.value > HOPEFUL * best and self._there(bench, drawn) is None:
                self.states.append(fresh)
        kept = [] if current is None else [current]
        for state in sorted((s for s in self.states if s is not current), key=lambda s: -s.value):
            apart = [np.max(distances(state.placed.points, other.placed.points)) for other in kept]
            if len(kept) < FOLLOWED and min(apart, default=np.inf) > 1e-3 * bench.scaling.length:
                kept.append(state)
        self.states = kept

    def improve(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Slide the current branch to where it is best, and then one that may be better."""
        self._steps += 1
        for state in [] if current is None else [current]:
            self._slide(bench, state, rng)
        best = max((state.value for state in self.states), default=0.0)
        for state in self.ranked():
            rests = self._steps - state.improved < REST and state.value < best
            if state is not current and state.value >= HOPEFUL * best and not rests:
                self._slide(bench, state, rng)
                return

    def _slide(self, bench: Workbench, state: Branch, rng: np.random.Generator) -> None:
        if len(state.cuts):
            exchange(bench, state, rng, Stop(), _near(bench))
            state.rounds, state.improved = 0, self._steps

    def ranked(self) -> list[Branch]:
        """Return the branches that resist the task, as far as is known, the best first."""
        return sorted((state for state in self.states if state.value > 0.0), key=lambda s: -s.value)

    def cold(self, bench: Workbench, rng: np.random.Generator) -> Iterator[Branch]:
        """Yield the branches that a cold solve finds for a task, the best first."""
        results = [run_start(bench, i, self._seed, Stop()) for i in range(self._starts)]
        solved = [r for r in results if isinstance(r, StartGrasp) and r.solved]
        for start in sorted(solved, key=lambda r: -r.record.mu.upper):
            state = self.add(bench, start.found.placed)
            state.placed = bench.snapped(start.found.placed)
            _look(bench, state, rng)
            state.effort += start.effort
            yield state


def _branch(bench: Workbench, placed: Placed) -> Branch:
    """Return where contacts and hand are as a branch that was not looked at yet."""
    unknown = np.zeros(len(bench.rows.named))  # multipliers, until a step is accepted
    return Branch(bench.snapped(placed), multipliers=unknown)


def _look(bench: Workbench, state: Branch, rng: np.random.Generator) -> None:
    """Compute quality and weakest directions of a branch for the task at hand."""
    known = None
    if len(state.cuts):
        known = with_known(state.cuts, np.zeros((0, bench.problem.dimension)), bench.problem.task)
    weakest = weakest_at(bench, state.placed, rng, known, AFTER_A_STEP)
    state.value, state.cuts, state.effort = weakest.value, weakest.directions, Effort()


def _near(bench: Workbench) -> Rules:
    rules = exchange_rules(bench)
    radius, gain = min(rules.radius, NEAR_RADIUS), max(rules.least_gain, NEAR_GAIN)
    return replace(rules, radius=radius, least_gain=gain, rounds=min(rules.rounds, NEAR_ROUNDS))


def moved(before: Grasp, after: Grasp, any_order: bool) -> FloatArray:
    """Return how far the contacts went, (k,), metres; in any order each finger takes the nearest of like contacts."""
    if not any_order:
        return np.asarray(np.linalg.norm(after.points - before.points, axis=1))
    return distances(after.points, before.points)


def distances(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the distances between two sets of contacts (k, space), paired for the least sum, (k,), metres."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    rows, columns = linear_sum_assignment(apart)
    return np.asarray(apart[rows, columns])
