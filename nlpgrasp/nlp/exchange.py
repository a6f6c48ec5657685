"""Exchange method for the semi-infinite program (3.5-4): directions by need, until beta is certified.

That the grasp contains the task is one inequality ``phi(y | G(p)) >= beta phi(y | A)`` (3.4-3) for every direction y. A
program with m of them bounds mu of every placement p that it allows. Each round solves it with the contacts in a box
about the best grasp c known so far, and certifies what it found: the weakest directions there join, and those with most
room leave (exchange methods of semi-infinite programming, Hettich and Kortanek 1993, doi:10.1137/1035089).

Convergence. With ``phi_A(y) = 1`` the supports are Lipschitz in p, with one constant L for all y. The weakest direction
of c is in the program, so in a box of half-width r it promises ``beta <= mu(c) + L r``. A round gains a tenth of its
promise, which happens finitely often because mu is bounded, or the box becomes smaller, until the promise is within
the tolerance: at the latest at ``r = rtol beta / L``. Where the box does not hold a contact, the end is a KKT point of
(3.5-4) with the directions that bind; where it does, mu has a kink there that no finite set of directions shows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.formulation_result import FormulationResult
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.measures import certify
from nlpgrasp.quality.weakest_directions import weakest_directions
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task

ROUNDS = 50  # programs solved, at most


Inner = Callable[[FormulationResult], FormulationResult]
Solve = Callable[[FloatArray, FormulationResult | None, float], FormulationResult]


class Exchange:
    """Directions of a program, exchanged until its beta is certified.

    Parameters
    ----------
    task : Task
    slots : int
        Number m of directions of the program.
    directions : (n, d) array
        Those to begin with.
    budget : callable
        Force budget at a result.
    rtol : float
        Relative difference allowed between beta and the certified lower bound.
    free_rounds : int
        Rounds without a box for a start whose mu is 0.
    failures : int
        Programs in a row that the solver may leave unsolved.
    """

    def __init__(
        self,
        task: Task,
        slots: int,
        directions: FloatArray,
        budget: Callable[[FormulationResult], ForceBudget],
        rtol: float,
        free_rounds: int = 6,
        failures: int = 6,
    ) -> None:
        self.task, self.slots, self.rtol, self._budget, self.free_rounds = task, slots, rtol, budget, free_rounds
        self.failures, self._rng = failures, np.random.default_rng(0)
        self._pool = np.zeros((0, directions.shape[1]))
        self._join(directions)
        self.chosen = np.resize(self._pool, (slots, directions.shape[1]))

    def maximise(self, solve: Solve, size: float, inner: Inner, rounds: int = ROUNDS) -> FormulationResult:
        """Return the grasp with the largest mu near a start, whose beta is certified.

        Parameters
        ----------
        solve : callable
            Solves the program with directions (m, d), the contacts in a box about those of a result or the start's if
            None, by its half-width, metres.
        size : float
            Of the body, metres.
        inner : callable
            Returns the solution from a result of the program whose forces produce wrenches of the task, ``"vertex"``.
            From contacts that do not hold it leads to those that do.
        rounds : int
            Programs solved, at most.
        """
        best = trial = solve(self.chosen, None, 1e-6 * size)
        mu = self._weakest(best) if best.success else 0.0
        if mu <= 0.0:
            best = trial = inner(best)
            mu = self._weakest(best)
        radius, failures = size if mu <= 0.0 else 0.2 * size, 0
        for number in range(1, rounds):
            self._choose([best, trial])
            trial = solve(self.chosen, best, radius)
            failures = 0 if trial.success else failures + 1
            if failures == self.failures:
                break
            found, promise = self._weakest(trial) if trial.success else 0.0, trial.beta - mu
            if promise <= 0.1 * self.rtol * trial.beta and trial.success:
                bounds = self._certify(trial)
                if bounds.lower >= (1.0 - self.rtol) * trial.beta and found >= (1.0 - 1e-6) * mu:
                    return self._unboxed(replace(trial, mu=bounds, rounds=number + 1), bounds, solve, size)
            gain = found - mu
            if mu <= 0.0 and number > self.free_rounds:
                break
            if mu <= 0.0:
                best, mu = trial, found  # no merit yet: directions alone lead to a grasp that holds
            elif gain > 0.1 * promise and gain > 0.0:
                best, mu = trial, found
                radius = min(size, 2.0 * radius) if gain > 0.5 * promise else radius
            else:
                radius = max(0.4 * radius, 1e-7 * size)
        return self._at(best, solve, 1e-7 * size, number + 1)

    def _unboxed(self, ended: FormulationResult, bounds: Bounds, solve: Solve, size: float) -> FormulationResult:
        """Return the program's solution from a result that a box held, where it is certified as well, else that."""
        if ended.kkt.locally_optimal:
            return ended
        free = solve(self.chosen, ended, size)
        found = self._certify(free)
        if free.success and found.lower >= max((1.0 - self.rtol) * free.beta, (1.0 - 1e-4) * bounds.lower):
            return replace(free, mu=found, rounds=ended.rounds + 1)
        return replace(ended, rounds=ended.rounds + 1)

    def _at(self, best: FormulationResult, solve: Solve, radius: float, rounds: int) -> FormulationResult:
        """Return the program's solution at the contacts of a result, with directions until beta is certified.

        Without one, that result with the certified beta.
        """
        for more in range(1, 6):
            self._choose([best])
            last = solve(self.chosen, best, radius)
            bounds = self._certify(last)
            if last.success and bounds.lower >= (1.0 - self.rtol) * last.beta:
                return replace(last, mu=bounds, rounds=rounds + more)
        bounds = self._certify(best)
        return replace(best, values=best.values | {"beta": np.array([bounds.lower])}, mu=bounds, rounds=rounds + more)

    def contain(self, solve: Solve, rounds: int = ROUNDS) -> FormulationResult:
        """Return a solution of a program with another objective whose grasp contains beta times the task.

        ``solve`` is as in ``maximise``.
        """
        result = solve(self.chosen, None, np.inf)
        for number in range(1, rounds + 1):
            bounds = self._certify(result)
            if bounds.lower >= (1.0 - self.rtol) * result.beta or number == rounds:
                break
            self._weakest(result)
            self._choose([result])
            result = solve(self.chosen, result, np.inf)
        return replace(result, mu=bounds, rounds=number)

    def _join(self, y: FloatArray) -> None:
        """Add the directions (n, d) along which the task requires something to the pool, with ``phi_A = 1``."""
        reach = self.task.support(y)[0]
        self._pool = np.concatenate([self._pool, y[reach > 0.0] / reach[reach > 0.0][:, None]])

    def _weakest(self, result: FormulationResult) -> float:
        """Return the least support ratio found of a result's grasp, nearly always mu; the weakest directions join."""
        weakest = weakest_directions(result.grasp, self.task, self._budget(result), self._rng, known=self.chosen)
        self._join(weakest.directions)
        return weakest.value

    def _certify(self, result: FormulationResult) -> Bounds:
        """Return the certified interval of mu of a result's grasp, whose worst direction joins."""
        bounds = certify(result.grasp, self.task, 0.2 * self.rtol, self._budget(result))
        if bounds.worst_direction is not None:
            self._join(bounds.worst_direction[None])
        return replace(bounds, vertices=None)

    def _choose(self, results: list[FormulationResult]) -> None:
        """Choose the directions of the pool with the least ratio in some results; those that stay keep their places."""
        supports = [WrenchSet.of(result.grasp, self._budget(result)).support(self._pool)[0] for result in results]
        order = np.argsort(np.min(supports, axis=0), kind="stable")
        alike = np.round(self._pool[order] / np.max(np.abs(self._pool), axis=0), 9)
        order = order[np.sort(np.unique(alike, axis=0, return_index=True)[1])][: 8 * self.slots]
        self._pool = self._pool[order]
        best = self._pool[: self.slots]
        same = np.all(self.chosen[:, None] == best, axis=2)
        fresh, free = best[~np.any(same, axis=0)], np.flatnonzero(~np.any(same, axis=1))
        self.chosen = self.chosen.copy()
        self.chosen[free[: len(fresh)]] = fresh
