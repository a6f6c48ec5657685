"""A solve that takes grasps known from elsewhere between its own starts and its answer."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.look_back import Aftermath
from nlpgrasp.solve.answer import Search, answer, solver_record
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start.coordinate_exchange import propose
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.start.result import StartGrasp, StartResult, best_of
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.solve.workers.pool import NOT_BEGUN, Runner


class Ongoing:
    """A solve in three steps: its own starts, grasps offered to it, its answer.

    Parameters
    ----------
    problem : GraspProblem
    starts : int
    seed : int
    options : SolveOptions

    Attributes
    ----------
    results : list of StartResult
        So far: of its own starts first.
    floor : float
        What its answer's mu is known to be at least: of the grasps offered with a floor, the best.
    """

    def __init__(self, problem: GraspProblem, starts: int, seed: int, options: SolveOptions) -> None:
        self.problem, self._seed = problem, seed
        self._options = replace(options.narrow(), rank="mu")  # what is promised to others is mu
        self._runner = Runner(problem, self._options, starts)
        self._starts, self._begun = starts, time.monotonic()
        limit = options.time_limit
        self._stop = Stop(None if limit is None else self._begun + limit)
        self.results: list[StartResult] = []
        self.floor = 0.0

    def run_starts(self) -> None:
        """Run its own starts, over the workers that the options allow."""
        with one_thread():
            self.results = sorted(self._runner.starts(self._seed, self._stop), key=lambda r: r.record.index)

    def scout(self, count: int) -> None:
        """Begin from candidates of one more coordinate exchange as well, ``count`` of them at most."""
        rng = np.random.default_rng([self._seed, self._starts])
        with one_thread():
            for placed in propose(self.bench, rng, count=count) if self.bench.follows_contacts else ():
                self.offer(Given(placed))

    @property
    def bench(self) -> Workbench:
        """The problem's workbench in this process."""
        return self._runner.bench

    @property
    def best(self) -> StartGrasp | None:
        """The best grasp so far; one whose certified bound is no lower than the floor, where there is one."""
        found = best_of(self.results)
        if found is None or found.record.mu.lower >= self.floor:
            return found
        return best_of([r for r in self.results if r.record.mu.lower >= self.floor])

    @property
    def reached(self) -> int:
        """How many starts, those from grasps that were offered among them, came within 2 % of the best so far."""
        best = self.best
        if best is None:
            return 0
        return sum(r.solved and r.record.mu.upper >= 0.98 * best.record.mu.lower for r in self.results)

    def offer(self, given: Given, improve: bool = True) -> bool:
        """Run starts from a known grasp; return whether the best grasp rose by more than its certificate's gap."""
        before = self.best
        index = max((r.record.index for r in self.results), default=-1) + 1
        new = run_given(self.bench, given, max(index, self._starts), self._stop, improve)
        self.results += new
        if new and new[0].solved and given.floor > self.floor:
            self.floor = given.floor
        after = self.best
        return after is not None and (before is None or after.record.mu.lower > before.record.mu.upper)

    def sharpen(self) -> None:
        """Certify the best grasp as tightly as the answer's certificate will be, for what it promises to others."""
        best = self.best
        if best is None:
            return
        budget, rtol = self.bench.budget(best.found.placed), self._options.final_rtol
        found = mu(best.found.grasp, self.problem.task, rtol, force_budget=budget, seed=self._seed)
        known = best.record.mu
        bounds = Bounds(max(found.lower, known.lower), min(found.upper, known.upper), found.worst_direction)
        place = next(i for i, r in enumerate(self.results) if r is best)
        self.results[place] = replace(best, record=replace(best.record, mu=bounds))
        self.floor = max(self.floor, bounds.lower)  # so that it stays the best, and the answer

    def finish(self) -> GraspSolution:
        """Return the answer, with what is worth knowing about it."""
        begun_all = len(self.results) >= self._starts and all(r.record.message != NOT_BEGUN for r in self.results)
        cut_short = None if begun_all else Status.TIME_LIMIT
        best, after = self.best, Aftermath()
        if not self._stop.requested():
            after = self._runner.look_back(best, self.results, self._seed, self._stop)
        # the answer is the best of the grasps, and that is the one looked back at
        told = [r if r is best or best is None else StartResult(r.record) for r in self.results]
        bound = self._runner.bound(best, self._stop)
        search = Search(self.problem, self._options, self._seed, told, cut_short, bound=bound)
        effort = replace(search, results=self.results).effort
        seconds = time.monotonic() - self._begun
        solution, _ = self._runner.analysed(answer(search, after), best, self._stop)
        return replace(solution, solver=solver_record(self._options, self._seed, effort, seconds))
