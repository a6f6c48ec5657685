"""Joint solution of problems with nested sets or types of contacts, by exchange of warm starts.

A grasp with fewer or poorer contacts is feasible for every larger problem, and never worse there: with forces x of its
own contacts and none of the others, ``G' x' = G x``. So ``G (B ∩ K)`` is inside ``G' (B' ∩ K')`` if the larger budget
allows the forces of the smaller one, with the other components zero. This holds for the L2 norm of all forces, for
bounds on each normal force or each force, for their sum, and for joint torques in the same posture. Then mu of the
larger grasp is at least that of the smaller, and every certified lower bound carries over. In the other direction, a
grasp of the larger problem is a warm start for the smaller one, without such a guarantee.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.registry import body_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import exchanged_candidates
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.optimize.warm_starts import WarmStart
from nlpgrasp.pipeline.multistart import Multistart
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution

# budgets for which bounds carry over
INHERITING_BUDGETS = ("l2", "per_finger", "per_finger_size", "shared", "hand_torques")
PROMISING = 0.5  # share of the larger problem's best above which a smaller one's grasp is refined
SWEEPS = 3  # most sweeps down and up


class ProblemConversion(Protocol):
    """Protocol of conversions of grasps between two problems of a family."""

    def extend_grasp(self, start: StartGrasp, small: CompiledProblem, large: CompiledProblem) -> WarmStart | None:
        """Return a warm start of the larger problem from a grasp of the smaller one, or ``None``."""

    def reduce_grasp(self, start: StartGrasp, large: CompiledProblem, small: CompiledProblem) -> WarmStart | None:
        """Return a warm start of the smaller problem from a grasp of the larger one, or ``None``."""


def solve_family(
    problems: Sequence[GraspProblem],
    pairs: Sequence[tuple[int, int]],
    step: ProblemConversion,
    starts: int,
    seed: int,
    options: SolveOptions,
) -> list[tuple[GraspSolution, int]]:
    """Solve problems with each other's grasps as warm starts, and return the solutions.

    Each solution comes with the number of starts near the best.

    Near means within 2 % of the best. No certified lower bound is below that of a smaller problem whose grasps are
    feasible for the larger.

    Parameters
    ----------
    problems : sequence of GraspProblem
        The smaller before the larger.
    pairs : sequence of (int, int)
        Indices of a smaller and a larger problem.
    step : ProblemConversion
    starts, seed, options
        As for ``solve``, for each problem.
    """
    by_mu = replace(options.narrow(), rank="mu")
    with single_thread():
        searches = [Multistart(StartRunner(problem, by_mu, starts), seed) for problem in problems]
        _Family(searches, pairs, step).run()
        return [(search.answer(), _count_near_best(search)) for search in searches]


class _Family:
    """Multistart searches of a family of problems, with mutual warm starts."""

    def __init__(
        self, searches: Sequence[Multistart], pairs: Sequence[tuple[int, int]], step: ProblemConversion
    ) -> None:
        self._searches, self._step = searches, step
        self._up = sorted(pairs, key=lambda pair: (pair[1], pair[0]))
        self._down = [(b, a) for a, b in sorted(pairs, reverse=True)]
        self._transferred: set[tuple[int, int, int]] = set()

    def run(self) -> None:
        """Run all starts, then transfer grasps to larger and smaller problems until no best grasp improves."""
        for search in self._searches:
            search.run_starts()
            search.close_gap()
            _run_further_starts(search)
        self._transfer_all(self._up)
        for _ in range(SWEEPS):
            if not self._transfer_all(self._down):
                break
            self._transfer_all(self._up)
        self._transfer_bounds()

    def _transfer_all(self, pairs: Sequence[tuple[int, int]]) -> bool:
        """Transfer grasps from the first to the second of each pair; return whether any best grasp improved."""
        improved = [self._transfer(source, target) for source, target in pairs]
        return any(improved)

    def _transfer(self, source: int, target: int) -> bool:
        """Run the best grasp of one search as a warm start of another, and return whether the other's best improved.

        No grasp is transferred twice.
        """
        source_search, target_search = self._searches[source], self._searches[target]
        start, incumbent, is_down = source_search.best, target_search.best, source > target
        if start is None or (source, target, start.record.index) in self._transferred:
            return False
        self._transferred.add((source, target, start.record.index))
        if is_down:
            warm_start = self._step.reduce_grasp(start, source_search.runner.compiled, target_search.runner.compiled)
        else:
            warm_start = self._extend(start, source_search, target_search)
        is_promising = incumbent is None or start.record.mu.upper >= PROMISING * incumbent.record.mu.lower
        return warm_start is not None and target_search.add_warm_start(warm_start, improve=is_down or is_promising)

    def _extend(self, start: StartGrasp, small: Multistart, large: Multistart) -> WarmStart | None:
        """Return a warm start of a larger problem from a grasp of a smaller one, with the inherited lower bound."""
        warm_start = self._step.extend_grasp(start, small.runner.compiled, large.runner.compiled)
        floor = inherited_lower_bound(start, small.runner.problem, large.runner.problem)
        return warm_start and replace(warm_start, floor=floor)

    def _transfer_bounds(self) -> None:
        """Certify the best grasps to the final accuracy, and transfer their lower bounds to larger problems."""
        for j, large in enumerate(self._searches):
            for small in (self._searches[a] for a, b in self._up if b == j):
                start, incumbent = small.chosen, large.best
                warm_start = None if start is None else self._extend(start, small, large)
                known_bound = 0.0 if incumbent is None else incumbent.record.mu.lower
                if warm_start is not None and warm_start.floor > known_bound:
                    large.add_warm_start(warm_start, improve=False)
            chosen = large.certify_best(large.runner.options.final_rtol)
            if chosen is not None:
                large.accept_unchanged(chosen)


def _run_further_starts(search: Multistart) -> None:
    """Run further starts from another coordinate exchange, half as many as before and at least two.

    There are none for a hand with a pose.
    """
    compiled, starts = search.runner.compiled, search.runner.count
    rng, count = np.random.default_rng([search.seed, starts]), max(2, -(-starts // 2))
    for candidate in exchanged_candidates(compiled, rng, count=count) if compiled.follows_contacts else ():
        search.add_warm_start(WarmStart(candidate))


def _count_near_best(search: Multistart) -> int:
    """Return the number of starts, including warm starts, whose mu is within 2 % of the best."""
    best = search.chosen
    if best is None:
        return 0
    return sum(r.solved and r.record.mu.upper >= 0.98 * best.record.mu.lower for r in search.results)


def inherited_lower_bound(start: StartGrasp, small: GraspProblem, large: GraspProblem) -> float:
    """Return the certified lower bound on mu that a larger problem inherits from a grasp of a smaller one, or 0.

    Parameters
    ----------
    start : StartGrasp
    small, large : GraspProblem
        Of the same body.
    """
    carries = small.budget == large.budget and small.budget.kind in INHERITING_BUDGETS
    carries = carries and small.task.to_dict() == large.task.to_dict() and bool((small.origin == large.origin).all())
    return start.record.mu.lower if carries else 0.0


def is_same_body(first: Body, second: Body) -> bool:
    """Return whether two bodies are known to be equal, by identity or by complete data."""
    if first is second:
        return True
    data = first.to_dict()
    try:
        body_from_dict(data)
    except InputError:
        return False
    return data == second.to_dict()
