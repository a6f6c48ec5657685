"""Local optima of a task that changes, side by side: where sliding along no longer helps, another one takes over."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solve.ascent.state import Effort
from nlpgrasp.solve.start.first_program import solve_first
from nlpgrasp.solve.start.screen import candidates
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.studies.sliding import Branch, at_most, look, slide

SAME, NEAR = (
    0.02,
    0.15,
)  # of the body's size: contacts this close, in any order, are the same grasp, and neighbours
SHARE = 1 / 3  # of a cold solve's starts are begun at each step, all of them at both ends of the path
FOLLOWED = 40  # branches at most: the best at hand
HOPEFUL, HOPEFUL_NEW = 0.85, 0.7  # of the best's quality: from there on another is slid, and one that never settled
OTHERS = 3  # slides of other branches a step
RISING = 5  # slides of a start that begins with next to nothing


class Branches:
    """Local optima that are followed through tasks, each slid to where it is best for the task at hand.

    The first programs of some starts are solved at every step before the first is taken: branches that begin at
    different tasks differ more than those of many starts at one. They are slid only once they may be the best.

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
        self._begun_before: set[tuple[int, int]] = set()  # workbench and number of starts
        self._steps, self._best = 0, 0.0  # taken, and the quality known at the last
        each = int(np.ceil(SHARE * starts))
        for step, bench in enumerate(benches):
            end = step in (0, len(benches) - 1)
            self._begin(bench, range(starts) if end else [(step * each + n) % starts for n in range(each)])

    def _begin(self, bench: Workbench, numbers: Iterable[int]) -> list[Branch]:
        """Add what the first programs of some of a cold solve's starts find where there is no branch; return them."""
        begun = len(self.states)
        for number in numbers:
            if (id(bench), number) in self._begun_before:
                continue
            self._begun_before.add((id(bench), number))
            found = self._begun(bench, number)
            if found is not None and _there(bench, found.placed, self.states) is None:
                self.states.append(found)
        return self.states[begun:]

    def _begun(self, bench: Workbench, number: int) -> Branch | None:
        """Return what a start's first program finds; None where that breaks constraints or fails."""
        rng = np.random.default_rng([self._seed, number])
        try:
            first = solve_first(bench, candidates(bench, rng, Stop()), rng)
        except (RuntimeError, np.linalg.LinAlgError):
            return None
        if first is None or first.score < 0.0:
            return None
        found = first.state
        branch = Branch(bench.snapped(found.placed), multipliers=found.multipliers, effort=found.effort)
        if first.score == 0.0:
            self._raise(bench, branch, rng)
        return branch

    def _raise(self, bench: Workbench, branch: Branch, rng: np.random.Generator) -> None:
        """Slide a branch that resists nothing as long as that helps."""
        look(bench, branch, rng)
        for _ in range(RISING):
            if slide(bench, branch, rng, self._steps) or branch.value <= 0.0:
                return

    def look(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Compute the quality of the branches for another task, and drop what has become the same; the best stay.

        A branch that is seen, by directions known of any, to be worse than the best by far is not looked at closely.
        """
        most, best = at_most(bench, self.states), 0.0
        order = sorted(range(len(most)), key=lambda i: (self.states[i] is not current, -most[i]))
        for i in order:
            state = self.states[i]
            state.effort, state.value = Effort(), float(most[i])
            if state is current or most[i] >= HOPEFUL_NEW * best:
                look(bench, state, rng)
                best = max(best, state.value)
        kept = [] if current is None else [current]
        for state in sorted((s for s in self.states if s is not current), key=lambda s: -s.value):
            if len(kept) < FOLLOWED and _there(bench, state.placed, kept) is None:
                kept.append(state)
        self.states = kept

    def improve(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Slide the current branch to where it is best, and then others that may be better.

        Where the task takes the current branch away, the rest of a cold solve's starts join first.
        """
        self._steps += 1
        if current is not None:
            slide(bench, current, rng, self._steps)
        if current is None or current.value < HOPEFUL * self._best:
            for state in self._begin(bench, range(self._starts)):
                look(bench, state, rng)
        for _ in range(OTHERS):
            following = self._next(bench, current)
            if following is None:
                break
            slide(bench, following, rng, self._steps)
        self._best = max((state.value for state in self.states), default=0.0)

    def _next(self, bench: Workbench, current: Branch | None) -> Branch | None:
        """Return the best branch that is not yet at its best and has no better one near it."""
        best = max((state.value for state in self.states), default=0.0)
        passed: list[Branch] = []
        for state in self.ranked():
            hopeful = state.value >= best * (HOPEFUL_NEW if state.settled < 0 else HOPEFUL)
            going = state is not current and state.settled < self._steps
            if hopeful and going and _there(bench, state.placed, passed, NEAR) is None:
                return state
            passed.append(state)
        return None

    def ranked(self) -> list[Branch]:
        """Return the branches that resist the task, as far as is known, the best first."""
        return sorted((state for state in self.states if state.value > 0.0), key=lambda s: -s.value)

    def cold(self, bench: Workbench, rng: np.random.Generator) -> list[Branch]:
        """Begin those of a cold solve's starts that were not begun for a task; return as many branches, best first."""
        for state in self._begin(bench, range(self._starts)):
            self._raise(bench, state, rng)
        return self.ranked()[: self._starts]


def _there(bench: Workbench, placed: Placed, states: Sequence[Branch], near: float = SAME) -> Branch | None:
    """Return the branch that contacts are on, or near, if any."""
    size = near * bench.scaling.length
    return next((b for b in states if np.max(distances(placed.points, b.placed.points)) <= size), None)


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
