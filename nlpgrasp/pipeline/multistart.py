"""Multistart search of a solve, with a method for each stage, and progress messages."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from nlpgrasp.analysis.analyse import add_analyses_to, add_friction, analyses_of, requested_analyses
from nlpgrasp.analysis.approaches import arrange_jaw_poses
from nlpgrasp.analysis.grip_force import add_grips
from nlpgrasp.analysis.infeasibility import diagnose_on_one_thread
from nlpgrasp.analysis.jaw_diagnosis import jaw_reasons, with_unusable_reason
from nlpgrasp.analysis.squeeze import add_squeezes
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.formatting import format_measure
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.distinct_grasps import ONE, GraspCollection, KeepOptions
from nlpgrasp.optimize.global_search import (
    RELAXED,
    STRIDE,
    evaluation_limit,
    missing_bound_reason,
    node_limit,
)
from nlpgrasp.optimize.hand_approach import add_hand_record, choose_free_approach
from nlpgrasp.optimize.local_convergence import converge_to_optimum
from nlpgrasp.optimize.parallel_starts import NOT_BEGUN, StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.propose import BATCH, deal_candidates, propose
from nlpgrasp.optimize.start import failed_start, run_start
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult, best_of
from nlpgrasp.optimize.warm_starts import KnownGrasp, WarmStart, run_warm_start
from nlpgrasp.pipeline.answer import (
    SearchRecord,
    make_answer,
    prefer_robust_start,
    restrict_to_squeezable,
    solver_record,
    total_effort,
    with_robustness,
)
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.analysis_records import WhyNot
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

STATUS_TEXT = {
    Status.NO_GRASP: "no grasp",
    Status.TIME_LIMIT: "out of time",
    Status.LOCALLY_INFEASIBLE: "constraints not kept",
}  # end of a start in progress messages, where it differs from the name of its status
ALTERNATIVES = 6  # grasps tried in place of an answer whose gripper is blocked, or whose pad overhangs
Progress = Callable[[StartRecord, Bounds], None]


class Multistart:
    """Multistart search with one method for each stage of a solve.

    The stages are ``compile``, ``begin_bound``, ``propose``, ``run_candidates``, ``close_gap``, ``choose``, ``bound``,
    ``certify`` and ``analyse``. Warm starts may be added until the answer is chosen. A search can resume from an
    earlier solution. Studies, which solve many related problems, also use ``prove`` and ``run_until_proved`` instead of
    ``close_gap``, and studies and experiments ``accept_unchanged`` instead of ``choose``.

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
        Results of the starts so far.
    floor : float
        Certified lower bound of mu, proved by warm starts, that the answer is not below.
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
        self._start_time, self._clock = time.monotonic(), Stopwatch()
        limit = runner.options.time_limit
        self.deadline = Deadline(None if limit is None else self._start_time + limit, flag)
        self._keeping, self._progress = keeping, progress
        self._others: GraspCollection | None = None
        self._tree: BranchAndBound | None = None
        self._nodes = 0  # nodes branched on beyond the root
        self._known_bound: GlobalBound | None = None
        self._spent = SolverEffort()

    @classmethod
    def resume(cls, runner: StartRunner, solution: GraspSolution, seed: int) -> Multistart:
        """Return a search that continues from a solution, with the solution's start records, bound and effort.

        The grasp of the solution is not among the results; a warm start has to add it.
        """
        search = cls(runner, seed)
        search.results = [StartResult(record) for record in solution.starts]
        if solution.bound is not None:
            search._known_bound = replace(solution.bound, stated_gap=None)  # the gap was to another grasp
        record, seconds = solution.solver, solution.solver.get("seconds", {})
        search._start_time -= float(seconds.get("total", 0.0))
        search._spent = SolverEffort(
            int(record.get("iterations", 0)),
            float(seconds.get("ipopt", 0.0)),
            float(seconds.get("functions", 0.0)),
            int(record.get("ipopt_calls", 0)),
            dict(record.get("ipopt_failures", {})),
        )
        return search

    @property
    def best(self) -> StartGrasp | None:
        """Best start so far.

        Where warm starts proved a lower bound of mu, only starts certified to reach it count.
        """
        best = best_of(self.results)
        if best is None or best.record.mu.lower >= self.floor:
            return best
        return best_of([r for r in self.results if r.record.mu.lower >= self.floor])

    @property
    def gap(self) -> float:
        """Relative gap between the best start and the bound so far; inf if either is missing."""
        best = self.best
        if self._tree is None or best is None or best.record.mu.lower <= 0.0:
            return float("inf")
        return self._tree.upper / best.record.mu.lower - 1.0

    @property
    def next_index(self) -> int:
        """Index of the next start beyond the requested ones."""
        return max([self.runner.count, *(r.record.index + 1 for r in self.results)])

    def compile(self) -> None:
        """Begin to compile the problem in the worker processes; this process compiles it on first use."""
        self.runner.prepare()

    def begin_bound(self) -> None:
        """Compute the root bound of a branch and bound, if it covers the problem."""
        self._clock.mark("programs")
        problem, options = self.runner.problem, self.runner.options
        self._tree = self.runner.branch_and_bound()
        if self._tree is None and options.gap is not None:
            warn(f"gap: {missing_bound_reason(problem)}; the answer is the best of its starts")
        self._clock.mark("bound")

    def run_starts(self, warm_starts: Sequence[KnownGrasp] = ()) -> None:
        """Run the stages from compilation to the end of the requested starts and warm starts.

        They are compile, root bound, propose, refine and certify.
        """
        self.compile()
        self.begin_bound()
        self.run_candidates(self.propose(), warm_starts)

    def run_candidates(
        self,
        candidates: Iterable[tuple[int, Sequence[GraspCandidate]]],
        warm_starts: Sequence[KnownGrasp] = (),
        settled: int = 4,
    ) -> None:
        """Refine and certify the candidates of each start, then each warm start unchanged and refined.

        Parameters
        ----------
        candidates : iterable of (int, sequence of GraspCandidate)
            Index of each start and its candidates.
        warm_starts : sequence of Grasp, FoundGrasp or GraspSolution
            Known grasps.
        settled : int
            Starts of a race that are polished to their local optimum, of each batch, where one grasp is asked for.
        """
        runner, deadline = self.runner, self.deadline
        settled = settled if self._keeping.count == 1 else BATCH
        starts = runner.run_starts(candidates, self.seed, deadline, settled)
        for result in chain(starts, runner.run_warm_starts(warm_starts, self.next_index, deadline)):
            self.results.append(result)
            if self._progress is not None:
                best = best_of(self.results)
                self._progress(result.record, Bounds(0.0, float("inf")) if best is None else best.record.mu)
        self.results.sort(key=lambda r: r.record.index)
        self._clock.mark("starts")

    def propose(self) -> Iterator[tuple[int, Sequence[GraspCandidate]]]:
        """Yield the index and the candidates of each requested start.

        Candidates are proposed in batches of starts, each with a random seed of its own, until the deadline. Where the
        proposal fails numerically, the starts of its batch are recorded as failed.
        """
        for first in range(0, self.runner.count, BATCH):
            if self.deadline.should_stop():
                return
            indices = range(first, min(first + BATCH, self.runner.count))
            rng = np.random.default_rng([self.seed, first])
            if first:
                self._clock.mark("starts")
            try:
                proposed = propose(self.runner.compiled, rng, starts=len(indices))
            except SOLVER_ERRORS as error:
                self.results += [failed_start(index, error) for index in indices]
                continue
            self._clock.mark("propose")
            yield from zip(indices, deal_candidates(proposed, len(indices)), strict=True)

    def add_warm_start(self, warm: WarmStart, improve: bool = True) -> bool:
        """Run a warm start in this process; return whether the best mu has provably risen."""
        self._clock.restart()
        previous = self.best
        new = run_warm_start(self.runner.compiled, warm, self.next_index, self.deadline, improve)
        self.results += new
        if new and new[0].solved and new[0].record.mu.lower >= warm.floor:
            self.floor = max(self.floor, warm.floor)
        self._clock.mark("starts")
        best = self.best
        return best is not None and (previous is None or best.record.mu.lower > previous.record.mu.upper)

    def prove(self, rtol: float) -> bool:
        """Certify the best start, branch on a few nodes, and return whether a study needs no further starts.

        Unlike ``close_gap``, it runs no starts. The search may end where the best start is within the bound's gap,
        memory is full, or the deadline has passed. The certificate has a relative gap of ``rtol``.
        """
        self._clock.restart()
        problem = self.runner.problem
        is_first = problem.body.space == 2 and not self._nodes  # in the plane nodes take less time than starts
        nodes = node_limit(problem, starts=4) if is_first else node_limit(problem, starts=2) // 4
        self.certify_best(rtol)
        is_finished = self._branch_further(nodes) or self.deadline.should_stop()
        self._clock.mark("starts")
        return is_finished

    def run_until_proved(
        self, starts: int, rtol: float, contacts: Sequence[FloatArray] | None = (), patience: int | None = None
    ) -> int:
        """Run starts one at a time in this process until ``prove`` ends them; for studies, not for ``ng.solve``.

        Parameters
        ----------
        starts : int
            Largest number of starts, at least 1.
        rtol : float
            Relative gap to which the best start is certified after each.
        contacts : sequence of (k, space) array
            Contacts of known grasps: candidates begin from them and from the bound's relaxed placements as well. None
            for neither, as in a solve.
        patience : int, optional
            Number of successive starts without an improvement by ``rtol`` after which to stop; unlimited by default.
            Starts before the first grasp do not count.

        Returns
        -------
        int
            Number of starts run.
        """
        self._clock.restart()
        idle = 0
        for count, candidates in enumerate(self._propose_near(contacts, starts), 1):
            before = self.best
            self._add_start(candidates)
            self._clock.mark("starts")
            old, new = (0.0 if start is None else start.record.mu.upper for start in (before, self.best))
            idle = 0 if new <= 0.0 or new > (1.0 + rtol) * old else idle + 1
            if count == starts or idle == patience or self.prove(rtol):
                return count
        return starts

    def replace_results(self, *starts: StartGrasp) -> None:
        """Replace the results that have the same indices as the given starts."""
        by_index = {start.record.index: start for start in starts}
        self.results = [by_index.get(result.record.index, result) for result in self.results]

    def certify_best(self, rtol: float) -> StartGrasp | None:
        """Certify the best start to a relative gap, and return it.

        Certified anew where another start becomes the best.
        """
        tight = set[int]()
        while (best := self.best) is not None and best.record.index not in tight:
            best = best.tighten_bounds(self.runner.problem, rtol, self.seed)
            self.replace_results(best)
            tight.add(best.record.index)
        return best

    def close_gap(self) -> None:
        """Branch and bound until the best grasp is within the requested gap, memory is full, or time is up.

        Further starts alternate with the branching; some of them begin from the bound's relaxed placements.
        """
        if self._tree is None or self.runner.options.gap is None:
            return
        follows_contacts = self.runner.compiled.follows_contacts
        while not self.deadline.should_stop() and not self._branch_further(STRIDE):
            if follows_contacts and not self.deadline.should_stop():
                self._add_start()
        self._clock.mark("closing the gap")

    def _add_start(self, candidates: Sequence[GraspCandidate] = ()) -> None:
        """Run one more start in this process, and append its result.

        It begins from given candidates. Without candidates the start proposes them itself, also from the bound's
        relaxed placements. Requested starts that have not been run come first.
        """
        finished = {result.record.index for result in self.results}
        index = next((i for i in range(self.runner.count) if i not in finished), self.next_index)
        relaxed = [] if candidates else self._relaxed_placements()
        self.results.append(run_start(self.runner.compiled, index, self.seed, self.deadline, relaxed, candidates))

    def _propose_near(self, contacts: Sequence[FloatArray] | None, starts: int) -> list[Sequence[GraspCandidate]]:
        """Return the proposed candidates of each further start, some of them near known contacts.

        Candidates near the bound's relaxed placements are proposed as well. ``contacts`` are arrays (k, space); with
        None, candidates are those of a solve with as many starts. They are empty where the proposal fails numerically:
        each start then proposes its own.
        """
        known = [] if contacts is None else [*contacts, *self._relaxed_placements()]
        try:
            proposed = propose(self.runner.compiled, np.random.default_rng([self.seed, 0]), known, starts)
        except SOLVER_ERRORS:
            return [()] * starts
        return deal_candidates(proposed, starts)

    def _relaxed_placements(self) -> list[FloatArray]:
        """Return contact positions (k, space) of the bound's latest relaxed placements."""
        return [] if self._tree is None else self._tree.relaxed_placements(RELAXED)

    def _branch_further(self, nodes: int) -> bool:
        """Branch on further nodes; return whether the gap is closed or memory is full."""
        if self._tree is None:
            return False
        best = self.best
        self._tree.update_incumbent(0.0 if best is None else best.record.mu.lower)
        self._tree.branch(nodes, self.deadline.should_stop)
        self._nodes += nodes
        return self._tree.is_finished

    def choose(self) -> None:
        """Choose the answer among the starts: at its local optimum, and with a collision-free approach."""
        runner, deadline, best = self.runner, self.deadline, self.best
        if best is None:
            return
        is_volume = runner.problem.objective == "nu"  # whose starts are at its optimum, not at that of mu
        results: Sequence[StartResult] = self.results
        weighs = runner.options.weighs_fragility and not is_volume and not deadline.should_stop()
        if weighs:
            best, results = restrict_to_squeezable(runner.problem.hand, best, results)
        last_step = partial(converge_to_optimum, deadline=deadline)
        converging = runner.begin(last_step, [] if is_volume else [best])
        if self._keeping.count > 1:
            self._others = GraspCollection(runner, self._keeping, deadline)  # while a worker converges
        best = next(iter(converging()), best)
        self._clock.mark("last step")
        if weighs and not deadline.should_stop():
            best = runner.run(partial(prefer_robust_start, results=results, deadline=deadline), best) or best
        self.replace_results(best)
        self._clock.mark("choice")
        if runner.problem.hand is not None and not deadline.should_stop():
            best, *blocked = runner.run(
                partial(choose_free_approach, results=self.results, deadline=deadline), best
            ) or (best,)
            self.replace_results(best, *blocked)
        if weighs and best.robust is None and not deadline.should_stop():  # another start has a free way in
            best = runner.run(with_robustness, best) or best
            self.replace_results(best)
        self._clock.mark("way in")
        self.chosen = best

    def accept_unchanged(self, best: StartGrasp) -> None:
        """Choose a start as the answer without moving it; its hand's approach is added."""
        with single_thread():
            self.chosen = add_hand_record(self.runner.compiled, best)
        self.replace_results(self.chosen)

    def answer(self, branch: bool = True) -> GraspSolution:
        """Return the solution with the chosen start, by the stages ``bound``, ``certify`` and ``analyse``.

        ``branch`` is that of ``bound``.
        """
        return self.analyse(self.certify(self.bound(branch)))

    def bound(self, branch: bool = True) -> GlobalBound | None:
        """Return the upper bound on mu over all placements, after a short branch and bound.

        None for problems that the bound does not cover. Where a gap is requested, ``close_gap`` has computed the bound;
        without ``branch`` it is the bound so far. A search resumed from a solution returns that solution's bound.
        """
        self._clock.restart()
        if self._tree is None:
            return self._known_bound
        best = self.chosen
        if best is not None:
            weak = np.array(best.kkt.directions) if best.kkt is not None and best.kkt.directions else None
            self._tree.update_incumbent(best.record.mu.lower, weak)
        if branch and self.runner.options.gap is None:
            size = self.runner.problem, self.runner.count
            tree, most = self._tree, evaluation_limit(*size)
            nodes = node_limit(*size) - self._nodes
            tree.branch(nodes, lambda: self.deadline.should_stop() or tree.evaluations > most)
        return self._tree.bound()

    def certify(self, bound: GlobalBound | None) -> GraspSolution:
        """Return the solution: the chosen start with its certificate, or a diagnosis if no start was chosen.

        The workers begin to certify the other distinct grasps, where these are requested.
        """
        runner, deadline, clock, best, reason = self.runner, self.deadline, self._clock, self.chosen, None
        search = SearchRecord(
            runner.problem,
            runner.options,
            self.seed,
            self.results,
            self._early_end_status,
            deadline,
            bound,
            clock,
            best,
        )
        clock.mark("bound")
        if best is None and not deadline.should_stop():
            if any(isinstance(r, StartGrasp) for r in self.results):
                reason = runner.run(partial(diagnose_on_one_thread, seed=self.seed, deadline=deadline), self.results)
            elif reasons := jaw_reasons(runner.problem):  # every start ended with an error
                reason = WhyNot(reasons=reasons)
            clock.mark("why not")
        if best is not None and self._needs_alternatives(best):
            alternatives = replace(self._keeping, count=max(self._keeping.count, ALTERNATIVES))
            self._others = GraspCollection(runner, alternatives, deadline, turns_pads=False)
        if self._others is not None and best is not None:
            self._others.begin(best, self.results)
            clock.mark("other grasps")
        solution = make_answer(search, reason)
        clock.mark("answer")
        return solution

    def _needs_alternatives(self, best: StartGrasp) -> bool:
        """Return whether other grasps are needed since the gripper is blocked or a pad overhangs.

        Only for a parallel gripper with given sizes, where a single grasp is kept.
        """
        hand, body = self.runner.problem.hand, self.runner.problem.body
        is_sized = isinstance(hand, ParallelJaw) and hand.is_solid and body.space == 3
        return is_sized and self._others is None and bool(best.record.obstruction) and not self.deadline.should_stop()

    def analyse(self, solution: GraspSolution) -> GraspSolution:
        """Return the solution with the requested analyses, the other distinct grasps and the record of the solve."""
        solution, problem = self._add_analyses(solution), self.runner.problem
        if self._others is not None:
            hand = problem.hand
            solution = add_grips(add_squeezes(replace(solution, others=self._others.grasps()), hand), hand)
            self._clock.mark("other grasps")
        options = self.runner.options.to_dict()
        solution = arrange_jaw_poses(solution, problem, self._keeping.count, options)
        solution = with_unusable_reason(solution, problem)
        if isinstance(problem.hand, ParallelJaw) and not self.deadline.should_stop():
            solution = add_friction(solution)
            self._clock.mark("friction")
        effort, seconds = total_effort(self.results) + self._spent, time.monotonic() - self._start_time
        record = solver_record(self.runner.options, self.seed, effort, seconds, solution.mu, self._clock.seconds)
        if self._keeping.count > 1:
            record = {**record, "keep": self._keeping.count, "distinct": self._keeping.distinct}
        return replace(solution, solver=record)

    @property
    def _early_end_status(self) -> Status | None:
        """Status of a search that was interrupted, or ran out of time before all starts were begun; else None."""
        if self.deadline.is_interrupted():
            return Status.INTERRUPTED
        if not self.deadline.should_stop():
            return None
        records = [r.record for r in self.results if r.record.index < self.runner.count]
        count = sum(record.message != NOT_BEGUN for record in records)
        return Status.TIME_LIMIT if count < self.runner.count else None

    def _add_analyses(self, solution: GraspSolution) -> GraspSolution:
        """Return the solution with the analyses added that the options request."""
        runner, deadline, best = self.runner, self.deadline, self.chosen
        names = requested_analyses(runner.options, solution, runner.problem.hand)
        if best is None or not names or deadline.should_stop():
            return solution
        analyse = partial(analyses_of, names=names, deadline=deadline)
        values, seconds, messages = runner.run(analyse, best) or ({}, {}, [])
        self._clock.mark_with(seconds, "programs")
        for message in messages:
            warn(message)
        return add_analyses_to(solution, values, runner.problem.hand)


def progress_callback(progress: Progress | bool | None, starts: int) -> Progress | None:
    """Return the callback for finished starts, or None if there is none.

    Parameters
    ----------
    progress : callable, bool or None
        A callback; True for lines on standard error; False or None for none.
    starts : int
        Number of starts.

    Raises
    ------
    InputError
        For any other ``progress``.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return LineWriter(starts)
    if not callable(progress):
        raise InputError("progress", progress, "True for a line a start, or a function of a StartRecord and Bounds")
    return progress


class LineWriter:
    """Progress callback that writes one line per finished start to standard error.

    Parameters
    ----------
    starts : int
        Number of starts.
    """

    def __init__(self, starts: int) -> None:
        self._starts, self._finished, self._start_time = starts, 0, time.monotonic()

    def __call__(self, record: StartRecord, best: Bounds) -> None:
        """Write the line of a start: its status, the best certified bounds so far, seconds since the solve began."""
        self._finished += 1
        status = STATUS_TEXT.get(record.status, record.status.name.lower())
        if record.status is Status.SOLVED:
            status = f"{format_measure(best.kind)} in {record.mu}"
        incumbent = f"best {best}" if best.lower > 0.0 else "no grasp yet"
        seconds = time.monotonic() - self._start_time
        sys.stderr.write(f"start {self._finished} of {self._starts}: {status}; {incumbent}; {seconds:.1f} s\n")
        sys.stderr.flush()
