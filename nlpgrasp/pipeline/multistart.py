"""Multistart search for the best grasp of a problem, stage by stage, with progress messages."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from nlpgrasp.analysis.analyse import add_analyses_to, analyses_of, requested_analyses
from nlpgrasp.analysis.infeasibility import diagnose_on_one_thread
from nlpgrasp.analysis.squeeze import add_squeezes
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.formatting import format_measure
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.optimize.candidate import Effort, GraspCandidate
from nlpgrasp.optimize.distinct_grasps import ONE, GraspCollection, KeepOptions
from nlpgrasp.optimize.final_step import converge_to_optimum
from nlpgrasp.optimize.global_search import OFFERED, STRIDE, effort_of, missing_bound_reason, node_count, start_bound
from nlpgrasp.optimize.hand_approach import add_hand_record, choose_free_approach
from nlpgrasp.optimize.parallel_starts import NOT_BEGUN, StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.propose import propose, shares
from nlpgrasp.optimize.start import failed, run_start
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult, best_of
from nlpgrasp.optimize.warm_starts import KnownGrasp, WarmStart, run_warm_start
from nlpgrasp.pipeline.answer import SearchRecord, choose_start, make_answer, pressing_starts, solver_record
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

WORDS = {
    Status.NO_GRASP: "no grasp",
    Status.TIME_LIMIT: "out of time",
    Status.LOCALLY_INFEASIBLE: "constraints not kept",
}  # how a start ended, in progress messages, where its status has another name
TOGETHER = 8  # starts that candidates are proposed for together
Progress = Callable[[StartRecord, Bounds], None]


class Multistart:
    """State of a multistart search, whose stages are methods: starts, warm starts, gap closing, choice, answer.

    A search can take further starts and warm starts until its answer is made, and go on from an earlier solution
    (``resume``).

    Parameters
    ----------
    runner : StartRunner
    seed : int
    keeping : KeepOptions
    progress : callable, optional
    flag : Path, optional
        A file that exists once the user has interrupted the search.

    Attributes
    ----------
    results : list of StartResult
        Of all starts so far.
    floor : float
        Certified lower bound of mu that the answer keeps to, as warm starts prove it.
    chosen : StartGrasp or None
        The answer, once it is chosen.
    """

    def __init__(
        self,
        runner: StartRunner,
        seed: int,
        keeping: KeepOptions = ONE,
        progress: Progress | None = None,
        flag: Path | None = None,
    ) -> None:
        self.runner, self.seed = runner, seed
        self.results: list[StartResult] = []
        self.floor = 0.0
        self.chosen: StartGrasp | None = None
        self._begun, self._clock = time.monotonic(), Stopwatch()
        limit = runner.options.time_limit
        self.deadline = Deadline(None if limit is None else self._begun + limit, flag)
        self._keeping, self._progress = keeping, progress
        self._others: GraspCollection | None = None
        self._tree: BranchAndBound | None = None
        self._nodes = 0  # of the tree, asked for beyond its root
        self._known_bound: GlobalBound | None = None
        self._spent = Effort()

    @classmethod
    def resume(cls, runner: StartRunner, solution: GraspSolution, seed: int) -> Multistart:
        """Return the search that ended with a solution: its records of starts, bound and effort.

        Its answer is among the starts still to come.
        """
        search = cls(runner, seed)
        search.results = [StartResult(record) for record in solution.starts]
        if solution.bound is not None:
            search._known_bound = replace(solution.bound, stated_gap=None)  # the gap was to another grasp
        record, seconds = solution.solver, solution.solver.get("seconds", {})
        search._begun -= float(seconds.get("total", 0.0))
        search._spent = Effort(
            int(record.get("iterations", 0)),
            float(seconds.get("ipopt", 0.0)),
            float(seconds.get("functions", 0.0)),
            int(record.get("ipopt_calls", 0)),
            dict(record.get("ipopt_failures", {})),
        )
        return search

    @property
    def best(self) -> StartGrasp | None:
        """The best start so far: of those certified for at least the floor, where there are any."""
        best = best_of(self.results)
        if best is None or best.record.mu.lower >= self.floor:
            return best
        return best_of([r for r in self.results if r.record.mu.lower >= self.floor])

    @property
    def next_index(self) -> int:
        """Number of the next start: the starts asked for come first."""
        return max([self.runner.count, *(r.record.index + 1 for r in self.results)])

    def begin_bound(self) -> None:
        """Bound mu by the undivided tree of a branch and bound, where it covers the problem."""
        self._clock.restart()
        problem, options = self.runner.problem, self.runner.options
        self._tree = start_bound(problem, options)
        if self._tree is not None:
            self._tree.branch(0)
        elif options.gap is not None:
            warn(f"gap: {missing_bound_reason(problem)}; the answer is the best of its starts")
        self._clock.mark("bound")

    def run_starts(self, known: Sequence[KnownGrasp] = ()) -> None:
        """Propose, refine and certify: all starts asked for, and those from known grasps, each as it is and refined.

        The bound of the undivided tree comes before.
        """
        runner, deadline = self.runner, self.deadline
        runner.prepare()
        self.begin_bound()
        candidates = self._proposed()
        for result in chain(
            runner.starts(candidates, self.seed, deadline), runner.warm_starts(known, self.next_index, deadline)
        ):
            self.results.append(result)
            if self._progress is not None:
                best = best_of(self.results)
                self._progress(result.record, Bounds(0.0, float("inf")) if best is None else best.record.mu)
        self.results.sort(key=lambda r: r.record.index)
        self._clock.mark("starts")

    def _proposed(self) -> Iterator[tuple[int, Sequence[GraspCandidate]]]:
        """Yield the number and the candidates of each start asked for, proposed for some at a time, until a stop.

        Where numerics fail, starts are failed ones.
        """
        for first in range(0, self.runner.count, TOGETHER):
            if self.deadline.is_requested():
                return
            numbers = range(first, min(first + TOGETHER, self.runner.count))
            rng = np.random.default_rng([self.seed, first])
            if first:
                self._clock.mark("starts")
            try:
                proposed = propose(self.runner.compiled, rng, starts=len(numbers))
            except SOLVER_ERRORS as error:
                self.results += [failed(index, error) for index in numbers]
                continue
            self._clock.mark("propose")
            yield from zip(numbers, shares(proposed, len(numbers)), strict=True)

    def add(self, warm: WarmStart, improve: bool = True) -> bool:
        """Run a warm start in this process; return whether the best mu rose by more than its certificate's gap."""
        self._clock.restart()
        before = self.best
        new = run_warm_start(self.runner.compiled, warm, self.next_index, self.deadline, improve)
        self.results += new
        if new and new[0].solved and new[0].record.mu.lower >= warm.floor:
            self.floor = max(self.floor, warm.floor)
        self._clock.mark("starts")
        best = self.best
        return best is not None and (before is None or best.record.mu.lower > before.record.mu.upper)

    def run_until_proved(self, starts: int, rtol: float, known: Sequence[FloatArray] = ()) -> None:
        """Run starts one at a time in this process, until the bound proves the best one to be near the best possible.

        Parameters
        ----------
        starts : int
            At most.
        rtol : float
            Relative gap to which the best start is certified before.
        known : sequence of (k, space) array
            Contacts that candidates begin from as well.
        """
        self._clock.restart()
        nodes = node_count(self.runner.problem, 1) // 2
        for _ in range(starts):
            self.certify_best(rtol)
            if self._search_tree(nodes) or self.deadline.is_requested():
                break
            self._add_start(known)
        self._clock.mark("starts")

    def update(self, *starts: StartGrasp) -> None:
        """Put starts in the places of the results with their numbers."""
        by_index = {start.record.index: start for start in starts}
        self.results = [by_index.get(result.record.index, result) for result in self.results]

    def certify_best(self, rtol: float) -> StartGrasp | None:
        """Certify the best start to this relative gap, and whichever then is the best; return it."""
        tight = set[int]()
        while (best := self.best) is not None and best.record.index not in tight:
            best = best.tighten_bounds(self.runner.problem, rtol, self.seed)
            self.update(best)
            tight.add(best.record.index)
        return best

    def close_gap(self) -> None:
        """Search all placements until the best grasp is within the gap asked for of the bound, or a stop.

        Starts go on meanwhile, also from the placements that the bound rests on.
        """
        if self._tree is None or self.runner.options.gap is None:
            return
        follows_contacts = self.runner.compiled.follows_contacts
        while not self.deadline.is_requested() and not self._search_tree(STRIDE):
            if follows_contacts and not self.deadline.is_requested():
                self._add_start()
        self._clock.mark("closing the gap")

    def _add_start(self, known: Sequence[FloatArray] = ()) -> None:
        """Run one more start in this process, also from known contacts (k, space) and the bound's relaxed placements.

        The first ones are the starts asked for, where they were not run.
        """
        run = {result.record.index for result in self.results}
        index = next((i for i in range(self.runner.count) if i not in run), self.next_index)
        relaxed = [] if self._tree is None else self._tree.relaxed_placements(OFFERED)
        self.results.append(run_start(self.runner.compiled, index, self.seed, self.deadline, [*known, *relaxed]))

    def _search_tree(self, nodes: int) -> bool:
        """Branch on so many nodes more; return whether the bound proves the best start to be within its gap."""
        if self._tree is None:
            return False
        best = self.best
        self._tree.update_incumbent(0.0 if best is None else best.record.mu.lower)
        self._tree.branch(nodes, self.deadline.is_requested)
        self._nodes += nodes
        return self._tree.is_finished

    def choose(self) -> None:
        """Choose the answer among the starts, at the local optimum next to it, and with a free way of its hand."""
        runner, deadline, best = self.runner, self.deadline, self.best
        if best is None:
            return
        results: Sequence[StartResult] = self.results
        weighs = runner.options.weighs_fragility and not deadline.is_requested()
        if weighs:
            best, results = pressing_starts(runner.problem.hand, best, results)
        converging = runner.begin(partial(converge_to_optimum, deadline=deadline), [best])
        if self._keeping.count > 1:
            self._others = GraspCollection(runner, self._keeping, deadline)  # while a worker converges
        best = next(iter(converging()), best)
        self._clock.mark("last step")
        if weighs and not deadline.is_requested():
            best = runner.run(partial(choose_start, results=results, deadline=deadline), best) or best
        self.update(best)
        self._clock.mark("choice")
        if runner.problem.hand is not None and not deadline.is_requested():
            best, *blocked = runner.run(
                partial(choose_free_approach, results=self.results, deadline=deadline), best
            ) or (best,)
            self.update(best, *blocked)
        self._clock.mark("way in")
        self.chosen = best

    def take_as_answer(self, best: StartGrasp) -> None:
        """Take a start as the answer where it is, with the way in of its hand."""
        with single_thread():
            self.chosen = replace(best, hand=add_hand_record(self.runner.compiled, best).hand)
        self.update(self.chosen)

    def answer(self) -> GraspSolution:
        """Bound, certify and analyse the answer, and return the solution."""
        self._clock.restart()
        runner, deadline, clock, best, reason = self.runner, self.deadline, self._clock, self.chosen, None
        bound, cut_short = self._bound(best), self._cut_short
        search = SearchRecord(
            runner.problem, runner.options, self.seed, self.results, cut_short, deadline, bound, clock, best
        )
        clock.mark("bound")
        if best is None and not deadline.is_requested() and any(isinstance(r, StartGrasp) for r in self.results):
            reason = runner.run(partial(diagnose_on_one_thread, seed=self.seed, deadline=deadline), self.results)
            clock.mark("why not")
        if self._others is not None and best is not None:
            self._others.begin(best, self.results)
            clock.mark("other grasps")
        solution = make_answer(search, reason)
        clock.mark("answer")
        solution = self._analysed(solution, best)
        if self._others is not None:
            solution = add_squeezes(replace(solution, others=self._others.grasps()), runner.problem.hand)
            clock.mark("other grasps")
        effort, seconds = search.effort + self._spent, time.monotonic() - self._begun
        record = solver_record(runner.options, self.seed, effort, seconds, clock.seconds)
        if self._keeping.count > 1:
            record |= {"keep": self._keeping.count, "distinct": self._keeping.distinct}
        return replace(solution, solver=record)

    @property
    def _cut_short(self) -> Status | None:
        """Why the search ended before all starts asked for were done."""
        if self.deadline.is_interrupted():
            return Status.INTERRUPTED
        if not self.deadline.is_requested():
            return None
        records = [r.record for r in self.results if r.record.index < self.runner.count]
        begun = sum(record.message != NOT_BEGUN for record in records)
        return Status.TIME_LIMIT if begun < self.runner.count else None

    def _bound(self, best: StartGrasp | None) -> GlobalBound | None:
        """Return the bound over all placements, after a short branch and bound; None where it does not cover them.

        Where a gap is asked for it is as it was left, and that of an earlier solution as it states it.
        """
        if self._tree is None:
            return self._known_bound
        if best is not None:
            weak = np.array(best.kkt.directions) if best.kkt is not None and best.kkt.directions else None
            self._tree.update_incumbent(best.record.mu.lower, weak)
        if self.runner.options.gap is None:
            asked = self.runner.problem, self.runner.count
            tree, most = self._tree, effort_of(*asked)
            tree.branch(node_count(*asked) - self._nodes, lambda: self.deadline.is_requested() or tree.effort > most)
        return self._tree.bound()

    def _analysed(self, solution: GraspSolution, best: StartGrasp | None) -> GraspSolution:
        """Return the solution with the analyses that the options ask for."""
        runner, deadline = self.runner, self.deadline
        names = requested_analyses(runner.options, solution, runner.problem.hand)
        if best is None or not names or deadline.is_requested():
            return solution
        analyse = partial(analyses_of, names=names, deadline=deadline)
        values, seconds, messages = runner.run(analyse, best) or ({}, {}, [])
        self._clock.mark_with(seconds, "programs")
        for message in messages:
            warn(message)
        return add_analyses_to(solution, values, runner.problem.hand)


def progress_callback(progress: Progress | bool | None, starts: int) -> Progress | None:
    """Return the callback for finished starts, None without one.

    Parameters
    ----------
    progress : callable, bool or None
        A function as it is; True for lines on standard error; False or None for none.
    starts : int
        How many there are.

    Raises
    ------
    InputError
        On anything else.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return LineWriter(starts)
    if not callable(progress):
        raise InputError("progress", progress, "True for a line a start, or a function of a StartRecord and Bounds")
    return progress


class LineWriter:
    """Writer of one line per finished start to standard error.

    Parameters
    ----------
    starts : int
        How many there are.
    """

    def __init__(self, starts: int) -> None:
        self._starts, self._done, self._begun = starts, 0, time.monotonic()

    def __call__(self, record: StartRecord, best: Bounds) -> None:
        """Write the line of a start: how it ended, the best certified bounds so far, seconds since the solve began."""
        self._done += 1
        ended = WORDS.get(record.status, record.status.name.lower())
        if record.status is Status.SOLVED:
            ended = f"{format_measure(best.kind)} in {record.mu}"
        so_far = f"best {best}" if best.lower > 0.0 else "no grasp yet"
        seconds = time.monotonic() - self._begun
        sys.stderr.write(f"start {self._done} of {self._starts}: {ended}; {so_far}; {seconds:.1f} s\n")
        sys.stderr.flush()
