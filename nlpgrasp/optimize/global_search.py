"""Global optimisation of a placement: certified upper bound on mu, and a grasp close to it.

``best_possible`` alternates between starts and branch and bound. The other functions give ``ng.solve`` its branch and
bound, and the effort of a short one.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from nlpgrasp.bodies import Box, Mesh, Prism
from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.deadline import Deadline, InterruptHandler
from nlpgrasp.common.validation import number, share
from nlpgrasp.errors import InputError, NotCoveredError
from nlpgrasp.global_bound.allowed_regions import relaxed_problem
from nlpgrasp.global_bound.best_possible_result import BestPossible
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.global_bound.scope import scope_of
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import follows_contacts
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.start import run_start
from nlpgrasp.optimize.start_result import StartGrasp, StartResult
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds

NODES, OF_FLAT, OF_MESH = 400, 1000, 160  # nodes of many starts' bound: on curved, on flat faces (quicker), on a mesh
BESIDE_A_HAND = 100  # the same, with a hand that has a pose
EFFORT = 20_000_000  # supports evaluated in curved cells for many starts' bound, after which it ends: about 3 seconds
ONE, ONE_OF_FLAT, EACH = 0.15, 0.65, 0.35  # share of these for one start, for one on flat faces, for each other start
GAP = 0.01  # relative gap that the bound aims at where none is requested
SHARE = 0.7  # share of the requested gap that the tree closes; the rest is the answer's own certificate
STRIDE = 1000  # nodes between two starts that go on after the others
OFFERED = 8  # relaxed placements that a start beside the tree begins from as well
ROUGH = 0.01  # width of the certificates of starts, at most
FINE = 0.15  # width of the best grasp's certificate, relative to the requested gap
BETTER = 1e-3  # relative gain of mu above which another grasp is certified as narrowly
FIRST = 2  # starts before the tree grows; others follow when it has doubled
LEAST = 100  # nodes of the tree before the third start, at least


def best_possible(
    problem: GraspProblem,
    gap: float = 0.01,
    time_limit: float | None = 10.0,
    progress: Callable[[float, Bounds, int], None] | None = None,
) -> BestPossible:
    """Return a bound on mu over all placements of a problem's contacts, and the best grasp found on the way.

    Branch and bound (docs/how_close.md): for directions y with unit work of the task and weights w of sum one,
    ``mu^2 <= sum_i max_p sum_j w_j s_i(p, y_j)^2`` with the support s_i of contact i alone, so that contacts are
    bounded one by one over the cells that they may be in; the least such bound is a linear program. Grasps come from
    starts, as of ``ng.solve``, that begin from the placements that the bound rests on as well. The search stops
    when the gap is closed, when the time is up, or at Ctrl-C; the bound holds at any time.

    Parameters
    ----------
    problem : GraspProblem
        A body of flat faces (box, prism, polygon), a sphere, an ellipsoid, a cylinder, a torus, or a mesh, of which
        contacts touch the triangles themselves; point, friction or soft contacts; the ``"l2"``, ``"per_finger"``,
        ``"per_finger_size"`` or ``"shared"`` budget (the last with a looser bound). Constraints on single contacts
        shrink where these may be. A hand and constraints between contacts are left out: they only lower mu, and the
        answer names them.
    gap : float
        Relative gap between bound and best grasp at which to stop, above 0, at most 1.
    time_limit : float, optional
        Seconds of wall time; as long as it takes when ``None``.
    progress : callable, optional
        Called after each batch of nodes with the bound so far, the certified quality of the best grasp found, and how
        many nodes were looked at.

    Returns
    -------
    BestPossible
        With the bound as ``upper``, a grasp wherever one that exerts the task was found, and the certificate: the bound
        is what follows from its at most 10,000 leaves, of a mesh 40,000, though a search went on beyond them.

    Raises
    ------
    InputError
        On a gap or a time limit out of range, and on a problem that the bound does not cover: says which part.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "a GraspProblem")
    gap = share("gap", gap)
    limit = None if time_limit is None else number("time_limit", time_limit, above=0.0)
    begun, best = time.monotonic(), None
    tree = BranchAndBound(problem, gap)
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        deadline = Deadline(None if limit is None else begun + limit, Path(folder) / "stop")
        with InterruptHandler(deadline):
            tree.branch(0)
            compiled = CompiledProblem(relaxed_problem(problem), SolveOptions(workers=1, rtol=min(ROUGH, gap)))
            starts, due = 0, 0
            while not (tree.is_finished or deadline.is_requested()):
                if tree.nodes >= due or starts < FIRST:
                    found = run_start(compiled, starts, 0, deadline, tree.relaxed_placements(OFFERED))
                    best, starts, due = (
                        _better_certified(compiled, best, found, gap),
                        starts + 1,
                        max(LEAST, 2 * tree.nodes),
                    )
                    tree.update_incumbent(0.0 if best is None else best.record.mu.lower)
                else:
                    tree.branch(1, deadline.is_requested)
                if progress is not None:
                    progress(tree.upper, Bounds(0.0, 0.0) if best is None else best.record.mu, tree.nodes)
    proven, proof = tree.certificate()
    known = Bounds(0.0, 0.0) if best is None else best.record.mu
    upper = max(proven, known.lower)
    return BestPossible(
        upper,
        None if best is None else best.on_body.grasp,
        known.of_measure(problem.task.measure, problem.task.paper_beta),
        () if best is None else best.on_body.candidate.faces,
        upper <= known.lower * (1.0 + gap),
        tree.nodes,
        time.monotonic() - begun,
        tree.scope.dropped,
        proof,
        problem.to_dict(),
    )


def _better_certified(
    compiled: CompiledProblem, best: StartGrasp | None, found: StartResult, gap: float
) -> StartGrasp | None:
    """Return the better of the best grasp so far and what a start ended with, certified as narrowly as the gap asks."""
    if not (isinstance(found, StartGrasp) and found.solved):
        return best
    known = found.record.mu
    if best is not None and known.upper <= (1.0 + BETTER) * best.record.mu.upper:
        return best
    better = found.tighten_bounds(compiled.problem, FINE * gap)
    return better if best is None or better.record.mu.lower > best.record.mu.lower else best


def start_bound(problem: GraspProblem, options: SolveOptions) -> BranchAndBound | None:
    """Return a branch and bound before its first node; None where it does not cover the problem or is not wanted."""
    if not options.global_bound:
        return None
    try:
        return BranchAndBound(problem, GAP if options.gap is None else SHARE * options.gap)
    except NotCoveredError:
        return None


def node_count(problem: GraspProblem, starts: int) -> int:
    """Return the number of nodes of the short branch and bound for a number of starts."""
    flat, mesh = isinstance(problem.body, Box | Prism), isinstance(problem.body, Mesh)
    share = _share(problem, starts)
    if follows_contacts(problem):
        return int(share * (OF_MESH if mesh else OF_FLAT if flat else NODES))
    smooth = flat or isinstance(problem.budget, L2Budget)
    return int(share * BESIDE_A_HAND) if smooth and not mesh else 0


def effort_of(problem: GraspProblem, starts: int) -> float:
    """Return the effort at which the short branch and bound for a number of starts ends."""
    return _share(problem, starts) * EFFORT


def _share(problem: GraspProblem, starts: int) -> float:
    """Return the share of many starts' bound for a number of them."""
    flat = isinstance(problem.body, Box | Prism)
    return min(1.0, (ONE_OF_FLAT if flat else ONE) + EACH * (starts - 1))


def missing_bound_reason(problem: GraspProblem) -> str:
    """Return the reason why there is no global bound for a problem, as text."""
    try:
        scope_of(problem)
    except NotCoveredError as error:
        return f"there is no bound over all placements of this problem ({error.field}: {error.given})"
    return "no bound over all placements was looked for"
