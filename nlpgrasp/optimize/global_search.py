"""Global optimisation of contact placement: certified upper bound on mu, and a grasp close to the bound.

``best_possible`` alternates between starts and branch and bound. The other functions set up the branch and bound of
``ng.solve``, and limit its size.
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

NODES, FLAT_NODES, MESH_NODES = 400, 1000, 160  # nodes with many starts: curved faces, flat faces, a mesh
POSED_HAND_NODES = 100  # the same, with a hand that has a pose
EVALUATIONS = 20_000_000  # supports evaluated in curved cells, at most, with many starts: about 3 seconds
FIRST_SHARE_FLAT = 0.65  # share of these limits for one start on flat faces; elsewhere it has the root bound alone
FURTHER_SHARE = 0.35  # share for each further start
GAP = 0.01  # relative gap at which the tree stops where none is requested
SHARE = 0.7  # share of the requested gap for the tree; the rest is for the answer's own certificate
STRIDE = 1000  # nodes between two further starts
RELAXED = 8  # relaxed placements of the tree from which a further start begins as well
ROUGH = 0.01  # relative width of the certificates of starts, at most
FINE = 0.15  # relative width of the best grasp's certificate, over the requested gap
GAIN = 1e-3  # relative gain of mu above which another grasp is certified as narrowly
FIRST_STARTS = 2  # starts before the tree grows; a further one each time it has doubled
LEAST_NODES = 100  # nodes of the tree before the third start, at least


def best_possible(
    problem: GraspProblem,
    gap: float = 0.01,
    time_limit: float | None = 10.0,
    progress: Callable[[float, Bounds, int], None] | None = None,
) -> BestPossible:
    """Return an upper bound on mu over all placements of a problem's contacts, and the best grasp found.

    Branch and bound (docs/how_close.md): for directions y with unit support of the task and weights w of sum one,
    ``mu^2 <= sum_i max_p sum_j w_j s_i(p, y_j)^2`` with the support s_i of contact i alone, so that contacts are
    bounded one by one over their cells; the least such bound is a linear program. Grasps come from starts, as in
    ``ng.solve``, that begin from the relaxed placements of the bound as well. The search stops when the gap is closed,
    at the time limit, or at Ctrl-C; the bound holds at any time.

    Parameters
    ----------
    problem : GraspProblem
        A body of flat faces (box, prism, polygon), a sphere, an ellipsoid, a cylinder, a torus, or a mesh, whose
        contacts are on the triangles themselves; point, friction, soft, line or plane contacts; the ``"l2"``,
        ``"per_finger"``, ``"per_finger_size"`` or ``"shared"`` budget (the last with a looser bound). A line or a
        rectangle in space is bounded by the disc around it. Constraints on single contacts reduce their regions. A hand
        and constraints between contacts are left out: they only lower mu, and the result names them.
    gap : float
        Relative gap between bound and best grasp at which to stop, above 0, at most 1.
    time_limit : float, optional
        Seconds of wall time; unlimited when ``None``.
    progress : callable, optional
        Called after each batch of nodes with the bound so far, the certified quality of the best grasp so far, and the
        number of nodes.

    Returns
    -------
    BestPossible
        The bound is ``upper``; there is a grasp if a known one exerts the task. The certificate proves the bound by at
        most 10,000 leaves, for a mesh 40,000, though the search may have had more.

    Raises
    ------
    InputError
        For a gap or a time limit out of range, and for a problem that the bound does not cover.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "a GraspProblem")
    gap = share("gap", gap)
    limit = None if time_limit is None else number("time_limit", time_limit, above=0.0)
    start_time = time.monotonic()
    tree = BranchAndBound(problem, gap)
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        deadline = Deadline(None if limit is None else start_time + limit, Path(folder) / "stop")
        with InterruptHandler(deadline):
            best = _search(problem, tree, gap, deadline, progress)
    proven, proof = tree.certificate()
    bounds = Bounds(0.0, 0.0) if best is None else best.record.mu
    upper = max(proven, bounds.lower)
    return BestPossible(
        upper,
        None if best is None else best.on_body.grasp,
        bounds.of_measure(problem.task.measure, problem.task.paper_beta),
        () if best is None else best.on_body.candidate.faces,
        upper <= bounds.lower * (1.0 + gap),
        tree.nodes,
        time.monotonic() - start_time,
        tree.scope.dropped,
        proof,
        problem.to_dict(),
    )


def _search(
    problem: GraspProblem,
    tree: BranchAndBound,
    gap: float,
    deadline: Deadline,
    progress: Callable[[float, Bounds, int], None] | None,
) -> StartGrasp | None:
    """Alternate between starts and branching until the gap is closed or time is up; return the best grasp."""
    best: StartGrasp | None = None
    tree.branch(0)
    compiled = CompiledProblem(relaxed_problem(problem), SolveOptions(workers=1, rtol=min(ROUGH, gap)))
    starts, next_start = 0, 0  # starts run; number of nodes at which the next one is due
    while not (tree.is_finished or deadline.should_stop()):
        if tree.nodes >= next_start or starts < FIRST_STARTS:
            result = run_start(compiled, starts, 0, deadline, tree.relaxed_placements(RELAXED))
            best = _better_certified(compiled, best, result, gap)
            starts, next_start = starts + 1, max(LEAST_NODES, 2 * tree.nodes)
            tree.update_incumbent(0.0 if best is None else best.record.mu.lower)
        else:
            tree.branch(1, deadline.should_stop)
        if progress is not None:
            progress(tree.upper, Bounds(0.0, 0.0) if best is None else best.record.mu, tree.nodes)
    return best


def _better_certified(
    compiled: CompiledProblem, best: StartGrasp | None, result: StartResult, gap: float
) -> StartGrasp | None:
    """Return the better of the best grasp so far and a start's grasp, certified to a fraction of the gap."""
    if not (isinstance(result, StartGrasp) and result.solved):
        return best
    bounds = result.record.mu
    if best is not None and bounds.upper <= (1.0 + GAIN) * best.record.mu.upper:
        return best
    better = result.tighten_bounds(compiled.problem, FINE * gap)
    return better if best is None or better.record.mu.lower > best.record.mu.lower else best


def root_branch_and_bound(problem: GraspProblem, options: SolveOptions) -> BranchAndBound | None:
    """Return a branch and bound with its root nodes bounded; None if disabled or not applicable to the problem."""
    if not options.global_bound:
        return None
    try:
        tree = BranchAndBound(problem, GAP if options.gap is None else SHARE * options.gap)
    except NotCoveredError:
        return None
    tree.branch(0)
    return tree


def node_limit(problem: GraspProblem, starts: int) -> int:
    """Return the largest number of nodes in the short branch and bound of a solve.

    It grows with the number of starts.
    """
    flat, mesh = isinstance(problem.body, Box | Prism), isinstance(problem.body, Mesh)
    fraction = _limit_fraction(problem, starts)
    if follows_contacts(problem):
        return int(fraction * (MESH_NODES if mesh else FLAT_NODES if flat else NODES))
    smooth = flat or isinstance(problem.budget, L2Budget)
    return int(fraction * POSED_HAND_NODES) if smooth and not mesh else 0


def evaluation_limit(problem: GraspProblem, starts: int) -> float:
    """Return the largest number of support evaluations in curved cells in the short branch and bound."""
    return _limit_fraction(problem, starts) * EVALUATIONS


def _limit_fraction(problem: GraspProblem, starts: int) -> float:
    """Return the fraction of the full limits of the short branch and bound for a number of starts."""
    flat = isinstance(problem.body, Box | Prism)
    return min(1.0, (FIRST_SHARE_FLAT if flat else 0.0) + FURTHER_SHARE * (starts - 1))


def missing_bound_reason(problem: GraspProblem) -> str:
    """Return the reason why there is no global bound for a problem, as text."""
    try:
        scope_of(problem)
    except NotCoveredError as error:
        return f"there is no bound over all placements of this problem ({error.field}: {error.given})"
    return "no bound over all placements was looked for"
