"""Checks of certified measures and their evidence: intervals, grasp map, worst direction, robustness."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.scalar_constraints import EDGE_MARGIN
from nlpgrasp.common.validation import number
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.quality.volume import nu
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check

OTHER_SEED = 7919  # of search directions other than the solver's
WIDER = 2.0  # allowed width over the recomputed one, where rounding ends a certificate early
MUCH_WIDER = 100.0  # the same, where the recomputed lower bound is zero
SMALL = 1e-9  # per unit force: smaller upper bounds count as zero
ANY_GAP = 1.0  # relative gap assumed for files that do not state the requested one
ERROR_BAR = 0.1  # largest relative error bar of nu; solves state less
NOTHING = 1e-3  # share of the grasp's quality: a smaller upper bound counts as nothing left
SAME = 1e-9  # tolerance of shares, which follow from other numbers of the file
OFF_BY = 1.5  # allowed displacement over the stated offset, as surfaces are curved
SLIPS = 0.99  # share of the offset: a contact nearer to an edge slips over it
PROVEN = 1e-5  # relative tolerance of the upper bound over the support ratio


def interval(stated: Bounds) -> Check:
    """Check that the lower end of an interval is not above its upper end."""
    good = bool(0.0 <= stated.lower <= stated.upper and np.isfinite(stated.upper))
    return Check("interval", good, f"stated {stated}")


def overlap(name: str, stated: Bounds, found: Bounds) -> Check:
    """Check that a stated interval and a recomputed one overlap."""
    good = stated.lower <= found.upper and found.lower <= stated.upper
    return Check(name, good, f"stated {stated}, recomputed {found}")


def width(name: str, stated: Bounds, found: Bounds, rtol: float) -> Check:
    """Check that a stated interval is no wider than its certificate's relative gap allows.

    Both are certified: the true value is at least ``found.lower``, and a certificate's upper bound is close to it if
    the lower bound is above zero.
    """
    least = found.lower / (WIDER * (1.0 + rtol))
    most = (WIDER if found.lower > 0.0 else MUCH_WIDER) * found.upper + SMALL
    good = bool(stated.lower >= least and stated.upper <= most)
    return Check(name, good, f"stated {stated}, a gap of {rtol:g} allows from {least:.5g} to {most:.5g}")


def widths(solution: GraspSolution, found: Bounds) -> list[Check]:
    """Check the width of the stated interval; a solve that was cut short may have any lower bound."""
    gap = solution.solver.get("options", {}).get("final_rtol", ANY_GAP)
    asked = number("final_rtol", gap, above=0.0) if solution.status in (Status.SOLVED, Status.OPTIMAL) else np.inf
    return [width("width", solution.mu, found, asked)]


def check_other_measures(solution: GraspSolution, grasp: Grasp, budget: ForceBudget, rtol: float) -> list[Check]:
    """Recompute delta and nu at the stated torque scale."""
    checks = []
    if solution.delta is not None:
        found = delta(grasp, solution.delta.torque_scale or 1.0, rtol, force_budget=budget)
        near = width("", solution.delta, found, ANY_GAP).passed
        both = overlap("delta", solution.delta, found)
        checks.append(Check("delta", both.passed and near, both.detail))
    if solution.nu is not None:
        volume = nu(grasp, solution.nu.torque_scale or 1.0, 0.05, force_budget=budget, seed=OTHER_SEED)
        error = min(solution.nu.error, ERROR_BAR * abs(volume.value))
        near = abs(volume.value - solution.nu.value) <= 2.0 * (volume.error + error)
        good = near and solution.nu.value in solution.nu and overlap("nu", solution.nu, volume).passed
        checks.append(Check("nu", good, f"stated {solution.nu}, recomputed {volume}"))
    return checks


def check_robustness(
    solution: GraspSolution, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float
) -> list[Check]:
    """Check the stated quality at the worst displacement found, and that its contacts are within reach."""
    stated = solution.robust
    if stated is None:
        return []
    models = [model.with_friction(1.0 - stated.friction_share) for model in grasp.contacts]
    rest, found = [i for i in range(len(models)) if i not in stated.lost], Bounds(0.0, 0.0)
    if rest:
        there = Grasp(stated.points[rest], stated.normals[rest], [models[i] for i in rest], grasp.torque_origin)
        found = mu(there, task, rtol, force_budget=budget, seed=OTHER_SEED)
    near = {c.fingers[0] for c in solution.constraints if c.kind == EDGE_MARGIN and c.value < SLIPS * stated.offset}
    over = set() if budget.depends_on_frames else near
    off = float(np.max(np.linalg.norm(stated.points - grasp.points, axis=1)))
    nothing = stated.mu.upper <= NOTHING * solution.mu.upper
    good = overlap("", stated.mu, found).passed and (nothing or width("", stated.mu, found, ANY_GAP).passed)
    good = good and set(stated.lost) == over
    good = good and solution.solver.get("options", {}).get("robust_offset", stated.offset) == stated.offset
    good = good and off <= OFF_BY * stated.offset + 1e-9 and stated.mu.lower <= solution.mu.upper
    share, fragile = stated.stated or (stated.share(solution.mu), stated.is_fragile(solution.mu))
    good = good and abs(share - stated.share(solution.mu)) <= SAME and fragile == stated.is_fragile(solution.mu)
    told = f"{len(stated.lost)} over an edge; {share:.3g} of mu left, {'' if fragile else 'not '}fragile"
    text = f"stated {stated.mu}, recomputed {found}; contacts at most {1e3 * off:.3g} mm off; {told}"
    return [Check("robustness", good, text)]


def grasp_map_check(grasp: Grasp) -> Check:
    """Compare ``G = T_f B`` with a column-by-column reconstruction."""
    columns = []
    for p, n, t, model in zip(grasp.points, grasp.normals, grasp.tangents, grasp.contacts, strict=True):
        arm = p - grasp.torque_origin
        for axis in model.axes(grasp.space):
            if axis >= grasp.space:  # a moment about the contact point
                turning = np.ones(1) if grasp.space == 2 else [n, *t][axis - 3]
                columns.append(np.concatenate([np.zeros(grasp.space), turning]))
                continue
            e = [n, *t][axis]
            moment = np.array([arm[0] * e[1] - arm[1] * e[0]]) if grasp.space == 2 else np.cross(arm, e)
            columns.append(np.concatenate([e, moment]))
    error = float(np.max(np.abs(np.array(columns).T - grasp.G))) / max(float(np.max(np.abs(grasp.G))), 1e-300)
    return Check("grasp map", error < 1e-9, f"rebuilt column by column, relative difference {error:.1e}")


def model_checks(solution: GraspSolution, grasp: Grasp, task: Task) -> list[Check]:
    """Compare the grasp's contact models and the kind of measure with the problem's."""
    asked = [contact_from_dict(c) for c in solution.problem["contacts"]]
    same = [c.to_dict() for c in asked] == [c.to_dict() for c in grasp.contacts]
    kind = task.measure
    return [
        Check("contact models", same, f"{len(grasp)} contacts, {'as' if same else 'not as'} the problem asks"),
        Check("kind of measure", solution.kind == kind, f"stated {solution.kind}, by the task {kind}"),
    ]


def direction_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Check that the support ratio along the stated worst direction is the stated upper bound on mu.

    The stated bound may be smaller, from another direction of the same solve, but never larger.
    """
    y = solution.mu.worst_direction
    if y is None:
        return []
    if y.shape != (grasp.dimension,):
        return [Check("worst direction", False, f"{y.size} numbers for dimension {grasp.dimension}")]
    reach = float(task.support(y[None])[0][0])
    if reach <= 0.0:
        return [Check("worst direction", False, "the task asks for nothing in the stated direction")]
    z = (grasp.G.T @ y)[None, :]
    work, force = force_set.support(z)
    ratio = float(max(work[0], force[0] @ z[0])) / reach
    least, most = solution.mu.lower, solution.mu.upper
    good = least <= ratio * (1.0 + 1e-6) + 1e-12 and most <= max(ratio, 0.0) * (1.0 + PROVEN) + 1e-12
    return [Check("worst direction", good, f"support ratio {ratio:.6g}, stated from {least:.6g} to {most:.6g}")]
