"""Resume of a solve with warm starts from other variations: better grasps are certified and refined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.optimize.start.result import StartGrasp, best_of
from nlpgrasp.optimize.start.warm_starts import WarmStart, adapted, certify_as_is, refine_warm_start
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.optimize.workers.one_thread import one_thread
from nlpgrasp.optimize.workers.pool import Runner
from nlpgrasp.pipeline.multistart import Multistart
from nlpgrasp.quality import Bounds, screen
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution

MARGIN = 1e-3  # least relative excess of a better grasp's certified upper bound
FINEST = 2e-4  # relative gap of a certificate that has to distinguish two grasps


def improved(
    bench: Workbench, starts: int, solution: GraspSolution, seed: int, offers: Mapping[str, FoundGrasp], improve: bool
) -> GraspSolution | None:
    """Return a solution improved by the best of some known grasps, refined; None where none is better.

    Each is certified under the compiled problem's own contacts, task, constraints and budget. One is taken if its
    certified upper bound exceeds the solution's by more than rounding, or by anything if the other problem's lower
    bound does: then no offered grasp contradicts that a more demanding problem is no better. The new certified bounds
    are never below the old. With starts compared by their worst case (``maximise_robust``) nothing is taken.

    Parameters
    ----------
    bench : Workbench
    starts : int
        Number of starts of the solution's solve.
    solution : GraspSolution
        Solution of the compiled problem.
    seed : int
        Seed of the solution.
    offers : mapping of str to FoundGrasp
        Grasps of problems with the same body, certified there, by their origin as text.
    improve : bool
        Whether to refine the taken grasp.
    """
    if bench.options.maximise_robust:
        return None
    search = Multistart.resumed(Runner(bench.problem, bench.options, starts, bench), solution, seed)
    known = solution.mu if solution.success else Bounds(0.0, 0.0)
    with one_thread():
        taken = _best(bench, search.next_index, known, offers)
        if taken is None:
            return None
        warm, found = taken
        ends, refined = [found], None
        if improve:
            refined = refine_warm_start(bench, warm, search.next_index + 1, search.stop)
        if refined is not None:
            ends.append(_certified_apart(bench, refined, known.lower))
        search.results += ends
        best = best_of([end for end in ends if _is_no_worse(end.record.mu, known)])
        if best is None:
            return None
        search.keep(best)
        answer = search.answer()
    return answer if _is_no_worse(answer.mu, known) else None


def _is_no_worse(bounds: Bounds, known: Bounds) -> bool:
    return bounds.lower >= known.lower and bounds.upper >= known.upper


def _best(
    bench: Workbench, index: int, known: Bounds, offers: Mapping[str, FoundGrasp]
) -> tuple[WarmStart, StartGrasp] | None:
    """Return the best offered grasp above the known bounds, as a warm start and certified as it is."""
    best = None
    for warm, elsewhere in _promising(bench, offers, known.upper):
        found = certify_as_is(bench, warm, index)
        margin = 0.0 if elsewhere.lower > known.upper else MARGIN
        if found is not None and found.record.mu.upper > (1.0 + margin) * known.upper:
            found = _certified_apart(bench, found, known.lower)
            if found.record.mu.lower >= known.lower:
                best, known = (warm, found), found.record.mu
    return best


def _certified_apart(bench: Workbench, found: StartGrasp, least: float) -> StartGrasp:
    """Return a grasp certified so tightly that its lower bound is above that of a worse one."""
    rtol = bench.options.final_rtol
    if least > 0.0:
        rtol = min(rtol, max(0.5 * (found.record.mu.upper / least - 1.0), FINEST))
    return found.certified(bench.problem, rtol)


def _promising(bench: Workbench, offers: Mapping[str, FoundGrasp], least: float) -> Iterator[tuple[WarmStart, Bounds]]:
    """Yield the grasps that fit the problem with a screened upper bound above ``least``, and their own mu."""
    fitting = [(warm, known.mu) for origin, known in offers.items() if (warm := adapted(bench, known, origin))]
    if not fitting:
        return
    bound = np.full(len(fitting), np.inf)
    if not bench.problem.budget.depends_on_frames:
        points = np.stack([warm.placed.points for warm, _ in fitting])
        normals = np.stack([_normals(bench, warm) for warm, _ in fitting])
        stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
        bound = screen(stack, bench.problem.task, force_budget=bench.problem.budget)
    for i in np.argsort(-bound, kind="stable"):
        if bound[i] > least:
            yield fitting[int(i)]


def _normals(bench: Workbench, warm: WarmStart) -> FloatArray:
    return np.where(np.isnan(warm.normals), bench.inward_normals(warm.placed), warm.normals)
