"""Continuation of several local optima along a changing task."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.best.branch_and_bound import BranchAndBound
from nlpgrasp.bodies import Box, Mesh, Prism
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solve.ascent.state import Effort
from nlpgrasp.solve.bounding import bounding
from nlpgrasp.solve.start.coordinate_exchange import propose
from nlpgrasp.solve.start.first_program import first_of
from nlpgrasp.solve.start.screen import candidates
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.studies.sliding import NEVER, Branch, at_most, look, slide

SAME, NEAR = 0.02, 0.15  # shares of the body's size: contact distances of equal and of neighbouring grasps
SHARE = 1 / 3  # share of a cold solve's starts run at each inner step without branch and bound
FOLLOWED = 40  # most branches: the best ones
HOPEFUL, HOPEFUL_NEW = 0.85, 0.8  # shares of the best quality that promising branches have: settled ones, new ones
OTHERS = 2  # refinements of other branches per step
RISING = 5  # most refinements of a start without quality
NODES, LONG = 180, 600  # branch-and-bound nodes per step; at the first step, and for flat faces


class Branches:
    """Local optima followed through a sequence of tasks by warm-started refinement.

    Where branch and bound covers the problem, a short run at each step shows whether a placement is better than the
    current branch, and finds such placements; the first programs of a cold solve's starts are solved at the first step
    alone, if the bound leaves a gap. Elsewhere those of some starts are solved for every step in advance: branches from
    different tasks differ more than those from many starts of one task.

    Parameters
    ----------
    benches : sequence of Workbench
        One per step of the path.
    starts : int
        Starts of a cold solve of one step.
    seed : int

    Attributes
    ----------
    states : list of Branch
    steps : int
        Steps taken so far.
    bound : GlobalBound or None
        Global bound for the task of the latest step, where branch and bound covers it.
    """

    def __init__(self, benches: Sequence[Workbench], starts: int, seed: int) -> None:
        self._starts, self._seed = starts, seed
        self.states: list[Branch] = []
        self.bound: GlobalBound | None = None
        self._begun_before: set[tuple[int, int]] = set()  # compiled problem and start number
        self.steps, self._best = 0, 0.0  # steps taken; best quality at the last step
        ahead = (_bounding(bench) for bench in benches)
        first = next(ahead)
        self._trees: Iterator[BranchAndBound | None] = chain([first], ahead)
        self._complete = first is not None and first.scope.complete
        each = int(np.ceil(SHARE * starts))
        for step, bench in enumerate([] if self._complete else benches):
            end = step in (0, len(benches) - 1)
            self._begin(bench, range(starts) if end else [(step * each + n) % starts for n in range(each)])

    def _begin(self, bench: Workbench, numbers: Iterable[int]) -> list[Branch]:
        """Add and return the new local optima of some of a cold solve's first programs."""
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
        """Return the branch of a start's first program; None where it violates constraints or fails."""
        rng = np.random.default_rng([self._seed, number])
        try:
            first = first_of(bench, candidates(bench, rng, Stop()), rng)
        except (RuntimeError, np.linalg.LinAlgError):
            return None
        if first is None or first.score < 0.0:
            return None
        none = np.zeros(len(bench.rows.named))
        branch = Branch(bench.snapped(first.placed), multipliers=none, effort=first.effort)
        if first.score == 0.0:
            self._raise(bench, branch, rng)
        return branch

    def _raise(self, bench: Workbench, branch: Branch, rng: np.random.Generator) -> None:
        """Refine a branch of zero quality as long as that helps."""
        look(bench, branch, rng)
        for _ in range(RISING):
            if slide(bench, branch, self.steps) or branch.value <= 0.0:
                return

    def improve(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Refine the current branch for the next task, and then others that may be better."""
        self.steps += 1
        for state in self.states:
            state.effort, state.value = Effort(), 0.0
        if current is not None:
            look(bench, current, rng)
            slide(bench, current, self.steps)
        if not self._search(bench, 0.0 if current is None else current.value, rng):
            if self._complete and self.steps == 1:
                self._begin(bench, range(self._starts))
            self._look(bench, current, rng)
        for _ in range(OTHERS if self.steps > 1 else max(OTHERS, self._starts)):
            following = self._next(bench, current)
            if following is None:
                break
            slide(bench, following, self.steps)
        self._best = max((state.value for state in self.states), default=0.0)

    def _search(self, bench: Workbench, known: float, rng: np.random.Generator) -> bool:
        """Run branch and bound for placements better than the known quality, and add them as branches.

        Returns whether no other branch can be much better than the known ones.
        """
        tree = next(self._trees)
        if tree is None:
            return False
        for placed in propose(bench, np.random.default_rng([self._seed, self.steps]), resume=True):
            found = bench.snapped(placed)
            if bench.violation(found) > FEASIBLE:
                continue
            state = _there(bench, found, self.states)
            if state is None:
                state = Branch(found, multipliers=np.zeros(len(bench.rows.named)))
                self.states.append(state)
            if state.value == 0.0:  # not yet evaluated for this task
                look(bench, state, rng)
                if state.value <= 0.0 and state.settled == NEVER:
                    self._raise(bench, state, rng)
            known = max(known, state.value)
        tree.expect(known)
        long = self.steps == 1 or isinstance(bench.problem.body, Box | Prism)
        tree.grow(LONG if long else NODES)
        self.bound = tree.bound()
        return tree.searched and self._complete

    def _look(self, bench: Workbench, current: Branch | None, rng: np.random.Generator) -> None:
        """Evaluate the other branches, and drop duplicates; keep the best.

        A branch whose upper bound, from the directions of all branches, is far below the best is not evaluated. Without
        branch and bound, the rest of a cold solve's starts join where the current branch loses much quality.
        """
        most, best = at_most(bench, self.states), max((state.value for state in self.states), default=0.0)
        for i in np.argsort(-most, kind="stable").tolist():
            state = self.states[i]
            if state.value > 0.0:
                continue
            state.value = float(most[i])
            if most[i] >= HOPEFUL_NEW * best:
                look(bench, state, rng)
                best = max(best, state.value)
        kept = [] if current is None else [current]
        for state in sorted((s for s in self.states if s is not current), key=lambda s: -s.value):
            if len(kept) < FOLLOWED and _there(bench, state.placed, kept) is None:
                kept.append(state)
        self.states = kept
        if not self._complete and (current is None or current.value < HOPEFUL * self._best):
            for state in self._begin(bench, range(self._starts)):
                look(bench, state, rng)

    def _next(self, bench: Workbench, current: Branch | None) -> Branch | None:
        """Return the best branch that is not yet locally optimal and has no better neighbour."""
        best = max((state.value for state in self.states), default=0.0)
        passed: list[Branch] = []
        for state in self.ranked():
            hopeful = state.value >= best * (HOPEFUL_NEW if state.settled < 0 else HOPEFUL)
            going = state is not current and state.settled < self.steps
            if hopeful and going and _there(bench, state.placed, passed, NEAR) is None:
                return state
            passed.append(state)
        return None

    def ranked(self) -> list[Branch]:
        """Return the branches of quality above zero, as far as known, best first."""
        return sorted((state for state in self.states if state.value > 0.0), key=lambda s: -s.value)

    def cold(self, bench: Workbench, rng: np.random.Generator) -> list[Branch]:
        """Run the remaining starts of a cold solve for a task; return as many branches, best first."""
        for state in self._begin(bench, range(self._starts)):
            self._raise(bench, state, rng)
        return self.ranked()[: self._starts]


def _bounding(bench: Workbench) -> BranchAndBound | None:
    """Return a branch and bound for the task of a step; None where its placements cannot be refined.

    None for meshes too, where it takes too long.
    """
    slides = bench.follows_contacts and not isinstance(bench.problem.body, Mesh)
    return bounding(bench.problem, bench.options) if slides else None


def _there(bench: Workbench, placed: Placed, states: Sequence[Branch], near: float = SAME) -> Branch | None:
    """Return the branch with nearby contacts, if any."""
    size = near * bench.scaling.length
    return next((b for b in states if np.max(distances(placed.points, b.placed.points)) <= size), None)


def moved(before: Grasp, after: Grasp, any_order: bool) -> FloatArray:
    """Return the contacts' displacements, (k,), metres; in any order each finger takes the nearest equal contact."""
    if not any_order:
        return np.asarray(np.linalg.norm(after.points - before.points, axis=1))
    return distances(after.points, before.points)


def distances(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the distances of two contact sets (k, space) in the matching of least sum, (k,), metres."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    rows, columns = linear_sum_assignment(apart)
    return np.asarray(apart[rows, columns])
