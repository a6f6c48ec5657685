"""Checks of the alternative grasps in a file: each like the answer, and all distinct."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, guarded

MOST = 6  # most contacts that are matched in every order
SLACK = 1e-9  # relative tolerance
Checked = Callable[[GraspSolution], Sequence[Check]]


def grasps_checks(solution: GraspSolution, checked: Checked, size: float) -> list[Check]:
    """Return one check per kept grasp, and one of their order and distinctness.

    Parameters
    ----------
    solution : GraspSolution
    checked : callable
        Returns the checks of a solution with one of them as its answer.
    size : float
        Upper bound on the body's size, metres.
    """
    if solution.stated_first is None and not solution.others:
        return []
    wrong = list(_together(solution, size))
    told = f"{len(solution.grasps)} distinct grasps, the first is the answer"
    checks = [Check("grasps kept", not wrong, "; ".join(wrong[:4]) if wrong else told)]
    for i, found in enumerate(solution.others, 1):
        alone = solution.with_answer(found)
        checks += guarded(f"grasps[{i}]", partial(_one, i, alone, checked))
    return checks


def _one(i: int, alone: GraspSolution, checked: Checked) -> list[Check]:
    """Return one check that combines those of one grasp."""
    checks = checked(alone)
    failed = [f"{check.name}: {check.detail}" for check in checks if check.failed]
    left = sum(not check.made for check in checks)
    told = f"mu in {alone.mu}, {len(checks) - left} checks" + (f", {left} not made" if left else "")
    return [Check(f"grasps[{i}]", not failed, "; ".join(failed[:4]) if failed else told)]


def _together(solution: GraspSolution, size: float) -> Iterator[str]:
    """Yield the inconsistencies between the kept grasps."""
    first = solution.stated_first
    if first is not None and first.to_dict() != solution.grasps[0].to_dict():
        yield "grasps[0] is another than the answer"
    indices = {start.index for start in solution.starts}
    named = [found.start for found in solution.grasps if found.start is not None]
    if len(set(named)) < len(named):
        yield "two grasps of one start"
    for i, found in enumerate(solution.others, 1):
        if found.start is not None and found.start not in indices:
            yield f"grasps[{i}] of start {found.start}, which there is not"
        if not found.mu.lower > 0.0:
            yield f"grasps[{i}] with no certified quality above zero"
        if found.kind != solution.kind:
            yield f"grasps[{i}] states {found.kind}, the file {solution.kind}"
    solver = solution.solver
    if len(solution.grasps) > solver.get("keep", len(solution.grasps)):
        yield f"{len(solution.grasps)} grasps where {solver.get('keep')} were to be kept"
    least = float(solver.get("distinct", 0.0)) * size * (1.0 - SLACK)
    for (i, one), (j, other) in combinations(enumerate(solution.grasps), 2):
        if (one.hand is None or "joint_positions" not in one.hand) and _apart(one, other) < least:
            yield f"grasps[{i}] and grasps[{j}] are one: contacts less than {least:.3g} m apart"


def _apart(one: FoundGrasp, other: FoundGrasp) -> float:
    """Return the largest contact distance of two grasps in the best order, metres; for many contacts a lower bound."""
    p, q = one.grasp.points, other.grasp.points
    if p.shape != q.shape:
        return np.inf
    distances: FloatArray = np.linalg.norm(p[:, None] - q[None], axis=2)
    k = len(p)
    if k > MOST:
        return np.inf
    models = one.grasp.contacts
    orders = np.array([o for o in permutations(range(k)) if all(models[i] == models[j] for i, j in enumerate(o))])
    return float(np.min(np.max(distances[np.arange(k), orders], axis=1)))
