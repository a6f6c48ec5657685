"""Checks of certified quality measures and of the data that support them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.scalar_constraints import EDGE_MARGIN
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import delta, mu, unit_ball
from nlpgrasp.quality.volume import nu
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check

OTHER_SEED = 7919  # seed of search directions, other than the solver's
WIDTH_FACTOR = 2.0  # allowed width over the recomputed one, where rounding ends a certificate early
ZERO_WIDTH_FACTOR = 100.0  # the same, where the recomputed lower bound is zero
ZERO_MU = 1e-9  # per unit force: smaller upper bounds count as zero
ANY_GAP = 1.0  # relative gap assumed for files that do not state the requested one
ERROR_BAR = 0.1  # largest relative error bar of nu; solves state less
NU_RTOL = 0.05  # relative error bar of the recomputed nu
ZERO_SHARE = 1e-3  # share of the grasp's quality: a smaller upper bound counts as zero
SHARE_TOLERANCE = 1e-9  # tolerance of shares, which follow from other numbers of the file
OFFSET_FACTOR = 1.5  # allowed displacement over the stated offset, as surfaces are curved
EDGE_SHARE = 0.99  # share of the offset: a contact nearer to an edge slips over it
RATIO_TOLERANCE = 1e-5  # relative tolerance of the upper bound over the support ratio


def interval_check(stated: Bounds) -> Check:
    """Return the check that an interval is ordered, at least zero and finite."""
    passed = bool(0.0 <= stated.lower <= stated.upper and np.isfinite(stated.upper))
    return Check("interval", passed, f"stated {stated}")


def are_overlapping(stated: Bounds, recomputed: Bounds) -> bool:
    """Return whether a stored interval and a recomputed one overlap."""
    return stated.lower <= recomputed.upper and recomputed.lower <= stated.upper


def overlap_check(name: str, stated: Bounds, recomputed: Bounds) -> Check:
    """Return the check that a stored interval and a recomputed one overlap."""
    return Check(name, are_overlapping(stated, recomputed), f"stated {stated}, recomputed {recomputed}")


def _widest_interval(recomputed: Bounds, rtol: float) -> tuple[float, float]:
    """Return the least lower and the largest upper bound that a certificate with a relative gap may state.

    Both are certified: the true value is at least ``recomputed.lower``, and a certificate's upper bound is close to it
    if the lower bound is above zero.
    """
    least_lower = recomputed.lower / (WIDTH_FACTOR * (1.0 + rtol))
    factor = WIDTH_FACTOR if recomputed.lower > 0.0 else ZERO_WIDTH_FACTOR
    return least_lower, factor * recomputed.upper + ZERO_MU


def _is_narrow(stated: Bounds, recomputed: Bounds, rtol: float) -> bool:
    """Return whether a stored interval is not wider than a certificate's relative gap allows."""
    least_lower, most_upper = _widest_interval(recomputed, rtol)
    return bool(stated.lower >= least_lower and stated.upper <= most_upper)


def width_check(name: str, stated: Bounds, recomputed: Bounds, rtol: float) -> Check:
    """Return the check that a stored interval is not wider than a certificate's relative gap allows."""
    low, high = _widest_interval(recomputed, rtol)
    text = f"stated {stated}, a gap of {rtol:g} allows from {low:.5g} to {high:.5g}"
    return Check(name, _is_narrow(stated, recomputed, rtol), text)


def mu_width_checks(solution: GraspSolution, recomputed: Bounds) -> list[Check]:
    """Return the check that the stored interval of mu is not too wide.

    A solve that was cut short may have any lower bound.
    """
    gap = solution.solver.get("options", {}).get("final_rtol", ANY_GAP)
    rtol = number("final_rtol", gap, above=0.0) if solution.status in (Status.SOLVED, Status.OPTIMAL) else np.inf
    return [width_check("width", solution.mu, recomputed, rtol)]


def check_other_measures(solution: GraspSolution, grasp: Grasp, budget: ForceBudget, rtol: float) -> list[Check]:
    """Return the checks of the stored measures delta and nu."""
    checks = []
    if (stated := solution.delta) is not None:
        recomputed = delta(grasp, stated.torque_scale or 1.0, rtol, force_budget=budget)
        passed = are_overlapping(stated, recomputed) and _is_narrow(stated, recomputed, ANY_GAP)
        checks.append(Check("delta", passed, f"stated {stated}, recomputed {recomputed}"))
    if (stated_nu := solution.nu) is not None:
        volume = nu(grasp, stated_nu.torque_scale or 1.0, NU_RTOL, force_budget=budget, seed=OTHER_SEED)
        error = min(stated_nu.error, ERROR_BAR * abs(volume.value))  # a wider stated error bar would excuse any value
        is_near = abs(volume.value - stated_nu.value) <= 2.0 * (volume.error + error)
        passed = is_near and stated_nu.value in stated_nu and are_overlapping(stated_nu, volume)
        checks.append(Check("nu", passed, f"stated {stated_nu}, recomputed {volume}"))
    return checks


def robustness_checks(
    solution: GraspSolution, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float
) -> list[Check]:
    """Return the check of the stored worst displacement and of the quality there."""
    stated = solution.robust
    if stated is None:
        return []
    models = [model.with_friction(1.0 - stated.friction_share) for model in grasp.contacts]
    remaining, recomputed = [i for i in range(len(models)) if i not in stated.lost], Bounds(0.0, 0.0)
    if remaining:
        displaced = Grasp(
            stated.points[remaining], stated.normals[remaining], [models[i] for i in remaining], grasp.torque_origin
        )
        recomputed = mu(displaced, task, rtol, force_budget=budget, seed=OTHER_SEED)
    near_edges = {
        c.fingers[0] for c in solution.constraints if c.kind == EDGE_MARGIN and c.value < EDGE_SHARE * stated.offset
    }
    slipping = set() if budget.depends_on_frames else near_edges
    displacement = float(np.max(np.linalg.norm(stated.points - grasp.points, axis=1)))
    is_zero = stated.mu.upper <= ZERO_SHARE * solution.mu.upper
    fraction = stated.share(solution.mu) if stated.stated_share is None else stated.stated_share
    is_fragile = stated.is_fragile(solution.mu) if stated.stated_fragile is None else stated.stated_fragile
    passed = all(
        (
            are_overlapping(stated.mu, recomputed),
            is_zero or _is_narrow(stated.mu, recomputed, ANY_GAP),
            set(stated.lost) == slipping,
            solution.solver.get("options", {}).get("robust_offset", stated.offset) == stated.offset,
            displacement <= OFFSET_FACTOR * stated.offset + 1e-9,
            stated.mu.lower <= solution.mu.upper,
            abs(fraction - stated.share(solution.mu)) <= SHARE_TOLERANCE,
            is_fragile == stated.is_fragile(solution.mu),
        )
    )
    summary = f"{len(stated.lost)} over an edge; {fraction:.3g} of mu left, {'' if is_fragile else 'not '}fragile"
    text = f"stated {stated.mu}, recomputed {recomputed}; contacts at most {1e3 * displacement:.3g} mm off; {summary}"
    return [Check("robustness", passed, text)]


def grasp_map_check(grasp: Grasp) -> Check:
    """Return the check of the grasp map ``G = T_f B`` against a reconstruction column by column."""
    columns = []
    for p, n, t, model in zip(grasp.points, grasp.normals, grasp.tangents, grasp.contacts, strict=True):
        arm = p - grasp.torque_origin
        for axis in model.axes(grasp.space):
            if axis >= grasp.space:  # a moment about the contact point
                moment_axis = np.ones(1) if grasp.space == 2 else [n, *t][axis - 3]
                columns.append(np.concatenate([np.zeros(grasp.space), moment_axis]))
                continue
            direction = [n, *t][axis]
            planar_moment = np.array([arm[0] * direction[1] - arm[1] * direction[0]])
            columns.append(np.concatenate([direction, planar_moment if grasp.space == 2 else np.cross(arm, direction)]))
    error = float(np.max(np.abs(np.array(columns).T - grasp.G))) / max(float(np.max(np.abs(grasp.G))), 1e-300)
    return Check("grasp map", error < 1e-9, f"rebuilt column by column, relative difference {error:.1e}")


def model_checks(solution: GraspSolution, grasp: Grasp, task: Task) -> list[Check]:
    """Return the checks that contact models, kind of measure and objective are those of the problem."""
    pad = (solution.problem.get("hand") or {}).get("pad")
    models = [contact_from_dict(c) for c in solution.problem["contacts"]]
    wanted, stated = ([_without_turn(c.to_dict(), pad) for c in contacts] for contacts in (models, grasp.contacts))
    agrees = wanted == stated
    kind = task.measure
    return [
        *_objective_checks(solution, task),
        Check("contact models", agrees, f"{len(grasp)} contacts, {'as' if agrees else 'not as'} the problem asks"),
        Check("kind of measure", solution.kind == kind, f"stated {solution.kind}, by the task {kind}"),
    ]


def _without_turn(contact: Json, pad: Sequence[float] | None) -> Json:
    """Return a contact's data without its direction if it is a gripper's whole pad, which turns with its approach."""
    is_pad = pad is not None and contact.get("extents") == list(pad)
    return {key: value for key, value in contact.items() if not (is_pad and key == "direction")}


def _objective_checks(solution: GraspSolution, task: Task) -> list[Check]:
    """Return the check that an objective other than mu was computed with the problem's torque scale."""
    name, scale = solution.objective, solution.problem.get("torque_scale")
    if name == "mu":
        return []
    stated = solution.delta if name == "delta" else solution.nu
    agrees = stated is None or stated.torque_scale == scale
    is_its_task = name != "delta" or (scale is not None and task == unit_ball(task.dimension, scale))
    text = f"{name} at a torque scale of {scale} m, {'' if is_its_task else 'not '}by its task"
    return [Check("objective", agrees and is_its_task, text)]


def direction_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Return the check that the stored bounds on mu are not above the support ratio along the worst direction.

    The stated bound may be smaller, from another direction of the same solve, but never larger.
    """
    y = solution.mu.worst_direction
    if y is None:
        return []
    if y.shape != (grasp.dimension,):
        return [Check("worst direction", False, f"{y.size} numbers for dimension {grasp.dimension}")]
    task_support = float(task.support(y[None])[0][0])
    if task_support <= 0.0:
        return [Check("worst direction", False, "the task asks for nothing in the stated direction")]
    contact_velocities = (grasp.G.T @ y)[None, :]
    supports, maximisers = force_set.support(contact_velocities)
    ratio = float(max(supports[0], maximisers[0] @ contact_velocities[0])) / task_support
    lower, upper = solution.mu.lower, solution.mu.upper
    passed = lower <= ratio * (1.0 + 1e-6) + 1e-12 and upper <= max(ratio, 0.0) * (1.0 + RATIO_TOLERANCE) + 1e-12
    return [Check("worst direction", passed, f"support ratio {ratio:.6g}, stated from {lower:.6g} to {upper:.6g}")]
