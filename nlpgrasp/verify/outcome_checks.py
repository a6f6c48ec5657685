"""Checks of a solve's stored outcome and of its alternative grasps."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from nlpgrasp.common.formatting import format_headroom
from nlpgrasp.solution.analysis_records import mu_before_margins
from nlpgrasp.solution.kept_grasps import DISTINCT_ANGLE, FoundGrasp, angle_between_poses
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE, link_obstructions, pad_share, way_obstructions
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, guard
from nlpgrasp.verify.quality_checks import is_finished

WITH_GRASP = (Status.SOLVED, Status.OPTIMAL, Status.TOUCHES)
WITHOUT_GRASP = (Status.LOCALLY_INFEASIBLE, Status.FAILED)
MU_TOLERANCE = 1e-9  # relative tolerance of mu
LEAST_ROBUST_SHARE = 0.5  # least share of a fragile start's mu with which a robust grasp wins over it
DISTANCE_TOLERANCE = 1e-9  # relative tolerance of the least distance of kept grasps
# options of a solve that say what its claims mean
DECIDING_OPTIONS = (
    *("final_rtol", "link_tolerance", "pregrasp_clearance", "robust_offset", "robust_friction"),
    *("joint_margin", "room_price", "maximise_robust", "rank", "gap", "method"),
)
CHOICES = {"rank": ("robust", "mu"), "method": ("steps", "program")}  # values of options
# reasons for which an alternative ranks before another, the weightiest first
RANKS = (
    "without a link inside anything",
    "with a free way in",
    "with more of a pad on its face",
    "not fragile",
    "of higher quality",
)

AnswerChecks = Callable[[GraspSolution], Sequence[Check]]


def outcome_checks(solution: GraspSolution) -> list[Check]:
    """Return the check that status, starts and winning start agree with the grasp and its quality."""
    errors = [*_status_errors(solution), *_answer_errors(solution), *_option_errors(solution)]
    summary = f"{solution.status.name.lower()}, {len(solution.starts)} starts"
    return [Check.of_errors("outcome", errors, summary)]


def _option_errors(solution: GraspSolution) -> Iterator[str]:
    """Yield an error if a solve does not state the options that its claims depend on."""
    missing = [name for name in DECIDING_OPTIONS if name not in solution.solver.get("options", {})]
    if solution.starts and missing:
        yield f"no {', '.join(missing)} among the options"
    for name, values in CHOICES.items() if solution.starts else ():
        if solution.solver.get("options", {}).get(name) not in values:
            yield f"options.{name} is none of {', '.join(values)}"


def _status_errors(solution: GraspSolution) -> Iterator[str]:
    """Yield errors if data of the file contradict the status."""
    status = solution.status.name.lower()
    if solution.grasp is None:
        if solution.status in WITH_GRASP:
            yield f"{status}, and no grasp"
        if solution.best_start is not None:
            yield f"no grasp, and start {solution.best_start} found it"
        return
    if solution.status in WITHOUT_GRASP or (solution.status is Status.NO_GRASP and solution.mu.lower > 0.0):
        yield f"{status}, and a grasp with mu in {solution.mu}"
    elif solution.status in WITH_GRASP and not solution.mu.lower > 0.0:
        yield f"{status}, and no certified quality above zero"
    if solution.status in WITH_GRASP and (solution.status is Status.TOUCHES) != solution.touches:
        yield f"{status}, and links that are stated to be {'inside something' if solution.touches else 'free'}"
    requested_gap = solution.solver.get("options", {}).get("gap")
    if solution.status is Status.OPTIMAL and not (isinstance(requested_gap, float) and solution.gap <= requested_gap):
        yield f"optimal, with a gap of {requested_gap} asked for, and {format_headroom(solution.gap)}"
    if solution.why_not is not None:
        yield "a grasp, and why there is none"


def _answer_errors(solution: GraspSolution) -> Iterator[str]:
    """Yield errors in the data of the winning start.

    The answer's certificate is recomputed and keeps the better ends of both. Without a search for robustness no other
    start is certainly better, except for mu traded for joint-limit margins, and for starts that are fragile or cannot
    be squeezed: a grasp with half their mu wins over them if it is robust or can be squeezed.
    """
    indices = [start.index for start in solution.starts]
    if len(set(indices)) < len(indices):
        yield "two starts of one index"
    # of a gripper with pads that turn or other contacts of its face another grasp may have become the answer
    is_jaw = (solution.problem.get("hand") or {}).get("type") == "parallel_jaw"
    if solution.best_start is None and is_finished(solution) and not is_jaw:
        yield "no start that found the grasp"
    best = None if solution.grasp is None or solution.best_start is None else solution.winner
    if best is None:
        return
    name = f"start {best.index}"
    if not best.has_grasp:
        yield f"{name} won and ended {best.status.name.lower()}"
    if best.faces != solution.faces:
        yield f"{name} won on other faces"
    low, high = solution.mu.lower * (1.0 + MU_TOLERANCE), solution.mu.upper * (1.0 - MU_TOLERANCE)
    if best.mu.lower > low or best.mu.upper < high:
        yield f"{name} won with mu in {best.mu}, stated {solution.mu}"
    options = solution.solver.get("options", {})
    is_by_volume = solution.objective == "nu"  # which the starts do not state
    if not (options.get("maximise_robust", False) or is_by_volume):
        largest_mu = max(best.mu.upper, _mu_without_margins(solution))
        preferred = _is_stated_robust(solution) or solution.squeeze is not None
        largest_mu /= LEAST_ROBUST_SHARE if options.get("rank") == "robust" and preferred else 1.0
        has_free_way = solution.has_free_way  # then obstructed starts rank behind it
        rivals = [s for s in solution.starts if s.status is Status.SOLVED and not (has_free_way and s.obstruction)]
        better_starts = [s.index for s in rivals if s.mu.lower > largest_mu]
        if better_starts:
            yield f"start {better_starts[0]} is better than start {best.index}, which won"


def _mu_without_margins(solution: GraspSolution) -> float:
    """Return the mu before the search for joint-limit margins, in files of earlier versions; else 0."""
    margins = (solution.hand or {}).get("room")
    return 0.0 if margins is None else mu_before_margins(margins)


def _is_stated_robust(solution: GraspSolution) -> bool:
    """Return whether a file says that its grasp is not fragile.

    Such a grasp may win over one with up to twice its mu.
    """
    return solution.robust is not None and not solution.is_fragile


def kept_grasp_checks(solution: GraspSolution, answer_checks: AnswerChecks, size: float) -> list[Check]:
    """Return a check for each alternative grasp, and a check of their order and distinctness.

    Parameters
    ----------
    solution : GraspSolution
    answer_checks : callable
        Returns the checks of a solution with one of them as its answer.
    size : float
        Upper bound on the body's size, metres.
    """
    if solution.stated_first is None and not solution.others:
        return []
    errors = list(_inconsistencies(solution, size))
    summary = f"{len(solution.grasps)} distinct grasps, the first is the answer"
    checks = [Check.of_errors("grasps kept", errors[:4], summary)]
    for i, kept_grasp in enumerate(solution.others, 1):
        variant = solution.with_answer(kept_grasp)
        checks += guard(f"grasps[{i}]", partial(_combined_check, i, variant, answer_checks))
    return checks


def _combined_check(i: int, variant: GraspSolution, answer_checks: AnswerChecks) -> list[Check]:
    """Return a single check that combines all checks of one alternative grasp."""
    checks = answer_checks(variant)
    failed = [f"{check.name}: {check.detail}" for check in checks if check.failed]
    unmade = sum(not check.made for check in checks)
    summary = f"mu in {variant.mu}, {len(checks) - unmade} checks" + (f", {unmade} not made" if unmade else "")
    return [Check.of_errors(f"grasps[{i}]", failed[:4], summary)]


def _inconsistencies(solution: GraspSolution, size: float) -> Iterator[str]:
    """Yield errors in the order, starts, quality and distinctness of the kept grasps."""
    first = solution.stated_first
    if first is not None and first.to_dict() != solution.grasps[0].to_dict():
        yield "grasps[0] is another than the answer"
    indices = {start.index for start in solution.starts}
    grasp_starts = [grasp.start for grasp in solution.grasps if grasp.start is not None]
    if len(set(grasp_starts)) < len(grasp_starts):
        yield "two grasps of one start"
    for i, grasp in enumerate(solution.others, 1):
        if grasp.start is not None and grasp.start not in indices:
            yield f"grasps[{i}] of start {grasp.start}, which there is not"
        if not grasp.mu.lower > 0.0:
            yield f"grasps[{i}] with no certified quality above zero"
        if grasp.kind != solution.kind:
            yield f"grasps[{i}] states {grasp.kind}, the file {solution.kind}"
    solver = solution.solver
    if len(solution.grasps) > solver.get("keep", len(solution.grasps)):
        yield f"{len(solution.grasps)} grasps where {solver.get('keep')} were to be kept"
    yield from _order_errors(solution)
    least = float(solver.get("distinct", 0.0)) * size * (1.0 - DISTANCE_TOLERANCE)
    for (i, a), (j, b) in combinations(enumerate(solution.grasps), 2):
        has_own_pose = "joint_positions" in (a.hand or {}) or angle_between_poses(a.hand, b.hand) >= DISTINCT_ANGLE
        if not has_own_pose and _matched_distance(a, b) < least:
            yield f"grasps[{i}] and grasps[{j}] are one: contacts less than {least:.3g} m apart"


def _order_errors(solution: GraspSolution) -> Iterator[str]:
    """Yield errors in the order of the alternatives; the answer is chosen by other rules.

    Grasps without obstructions come first, then those with more of a gripper's pads on their faces, then those that are
    not fragile if the solve weighs it, then higher quality.
    """
    options = solution.solver.get("options", {})
    by_remaining = bool(options.get("maximise_robust"))
    weighs_fragility = options.get("rank") == "robust" and options.get("gap") is None and not by_remaining

    def shortcomings(grasp: FoundGrasp) -> tuple[float, ...]:
        quality = grasp.robust.mu if by_remaining and grasp.robust is not None else grasp.mu
        touches, is_blocked = bool(link_obstructions(grasp.hand)), bool(way_obstructions(grasp.hand))
        overhang = 1.0 - pad_share(grasp.hand) if pad_share(grasp.hand) < LEAST_PAD_SHARE else 0.0
        return touches, is_blocked, overhang, weighs_fragility and grasp.is_fragile, -quality.lower

    for i, (first, second) in enumerate(pairwise(map(shortcomings, solution.others)), 1):
        if first > second:
            reason = next(name for name, a, b in zip(RANKS, first, second, strict=True) if a != b)
            yield f"grasps[{i}] ranks before grasps[{i + 1}], which is {reason}"


def _matched_distance(a: FoundGrasp, b: FoundGrasp) -> float:
    """Return the bottleneck distance between two grasps' contacts, metres.

    It is the largest distance in the best one-to-one matching.

    Only contacts of the same model are matched; infinite where the numbers of contacts differ.
    """
    p, q = a.grasp.points, b.grasp.points
    if p.shape != q.shape:
        return np.inf
    distances = np.linalg.norm(p[:, None] - q[None], axis=2)
    models = a.grasp.contacts  # those of b are the same
    is_other_model = np.array([[first != second for second in models] for first in models], dtype=bool)
    distances[is_other_model] = np.inf
    candidate_distances = np.unique(distances[np.isfinite(distances)])

    def has_matching(index: int) -> bool:
        return bool(np.all(maximum_bipartite_matching(csr_array(distances <= candidate_distances[index])) >= 0))

    # False ... False, True ... True: the least distance with a matching
    return float(candidate_distances[bisect_left(range(len(candidate_distances)), True, key=has_matching)])
