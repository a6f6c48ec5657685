"""Checks of certified quality measures and of the data that support them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.scalar_constraints import EDGE_MARGIN
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.confirmation import (
    USUAL_RTOL,
    ZERO_MU,
    RecomputedBounds,
    are_confirmed,
    reaches,
    recompute_bounds,
)
from nlpgrasp.quality.critical_friction import LARGEST, SMALLEST, HoldingForce, common_friction
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import unit_ball
from nlpgrasp.quality.own_measures import OWN_MEASURES
from nlpgrasp.quality.volume import nu
from nlpgrasp.solution.analysis_records import CriticalFriction, Robustness
from nlpgrasp.solution.kept_grasps import weighs_fragility
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.proved_bounds import OTHER_SEED, prove_anew, support_ratio

WIDTH_FACTOR = 2.0  # allowed width over the recomputed one, where rounding ends a certificate early
ZERO_WIDTH_FACTOR = 100.0  # the same, where the recomputed lower bound is zero
ANY_GAP = 1.0  # relative gap assumed for files that do not state the requested one
ERROR_BAR = 0.1  # largest relative error bar of nu; solves state less
NU_RTOL = 0.014  # relative error bar of the recomputed nu: a hull of twice the vertices of a solve's
GAP_SHARE = 0.2  # share of the gap asked for over all placements that a grasp's own certificate takes
ZERO_SHARE = 1e-3  # share of the grasp's quality: a smaller upper bound counts as zero
FORCE_WIDTH = 0.05  # allowed relative excess of a stated interval of force over the recomputed one
FRICTION_WIDTH = 0.03  # relative width of an interval of friction above which it is recomputed, to the same tolerance
SHARE_TOLERANCE = 1e-9  # tolerance of shares, which follow from other numbers of the file
OFFSET_FACTOR = 1.5  # allowed displacement over the stated offset, as surfaces are curved
EDGE_SHARE = 0.99  # share of the offset: a contact nearer to an edge slips over it
UNSTATED = "the file does not state what is left of mu when contacts are off, though its solve weighed it"
RATIO_TOLERANCE = 1e-5  # relative tolerance of the upper bound over the support ratio


def interval_check(stated: Bounds) -> Check:
    """Return the check that an interval is ordered, at least zero and finite."""
    passed = bool(0.0 <= stated.lower <= stated.upper and np.isfinite(stated.upper))
    return Check("interval", passed, f"stated {stated}")


def requested_rtol(solution: GraspSolution, rtol: float) -> float:
    """Return the relative gap that a solve's certificate of mu was to have; ``rtol`` if the file does not state it."""
    options = solution.solver.get("options", {})
    requested = number("solver.options.final_rtol", options.get("final_rtol", rtol), above=0.0)
    gap = options.get("gap")
    return requested if gap is None else min(requested, GAP_SHARE * number("solver.options.gap", gap, above=0.0))


def bounds_check(name: str, stated: Bounds, recomputed: RecomputedBounds) -> Check:
    """Return the check of stated bounds against recomputed ones."""
    text, error = f"stated {stated}, {recomputed.evidence}", unconfirmed_end(stated, recomputed)
    return Check.of_errors(name, [f"{text}: {error}"] if error else [], text)


def unconfirmed_end(stated: Bounds, recomputed: Bounds) -> str:
    """Return a text on the stated end that recomputed bounds do not confirm; empty if they confirm both."""
    if are_confirmed(stated, recomputed):
        return ""
    if not reaches(stated, recomputed):
        return f"at least {stated.lower:.9g} stated, {recomputed.lower:.9g} certified"
    return f"at most {stated.upper:.9g} stated, from {recomputed.lower:.9g} to {recomputed.upper:.9g} certified"


def recompute_mu(
    stated: Bounds, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float, requested: float | None = None
) -> RecomputedBounds:
    """Return recomputed bounds on mu, proved where that is possible; the stated worst direction counts, too."""
    y = stated.worst_direction
    if y is not None and y.shape != (grasp.dimension,):
        y = None
    return recompute_bounds(stated, lambda gap: prove_anew(grasp, task, gap, budget, y), rtol, requested)


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


def is_finished(solution: GraspSolution) -> bool:
    """Return whether a solve with a certified grasp ran to its end, so that its file states all that belongs to it."""
    return bool(solution.starts) and solution.status in (Status.SOLVED, Status.OPTIMAL, Status.TOUCHES)


def mu_width_checks(solution: GraspSolution, recomputed: Bounds) -> list[Check]:
    """Return the check that the stored interval of mu is not too wide.

    A solve that was cut short may have any lower bound.
    """
    gap = solution.solver.get("options", {}).get("final_rtol", ANY_GAP)
    rtol = number("final_rtol", gap, above=0.0) if solution.status in (Status.SOLVED, Status.OPTIMAL) else np.inf
    return [width_check("width", solution.mu, recomputed, rtol)]


def check_other_measures(solution: GraspSolution, grasp: Grasp, budget: ForceBudget, rtol: float) -> list[Check]:
    """Return the checks of the stored measures delta and nu, and of those from outside the package."""
    checks = []
    if (stated := solution.delta) is not None:
        scale = stated.torque_scale or 1.0
        recomputed = recompute_mu(
            stated, grasp, unit_ball(grasp.dimension, scale).given_about(grasp.torque_origin), budget, rtol
        )
        checks += [bounds_check("delta", stated, recomputed), width_check("delta, width", stated, recomputed, ANY_GAP)]
    if (stated_nu := solution.nu) is not None:
        scale = stated_nu.torque_scale or 1.0
        volume = recompute_bounds(
            stated_nu, lambda gap: nu(grasp, scale, gap, force_budget=budget, seed=OTHER_SEED), NU_RTOL, NU_RTOL
        )
        error = min(stated_nu.error, ERROR_BAR * abs(volume.value))  # a wider stated error bar would excuse any value
        is_near = abs(volume.value - stated_nu.value) <= 2.0 * (volume.error + error)
        passed = is_near and stated_nu.value in stated_nu and are_confirmed(stated_nu, volume)
        checks.append(Check("nu", passed, f"stated {stated_nu}, recomputed {volume}"))
    for measure in solution.measures:
        own = OWN_MEASURES.get(measure.name)
        if own is None:
            checks.append(Check.not_made(measure.name, "nothing recomputes a measure of that name"))
            continue
        value = own.value(grasp, solution.task, budget)
        passed = own.agrees(measure.value, value) and own.unit == measure.unit
        checks.append(Check(measure.name, passed, f"stated {measure.value:.9g} {measure.unit}, recomputed {value:.9g}"))
    return checks


def robustness_checks(
    solution: GraspSolution, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float
) -> list[Check]:
    """Return the check of the stored worst displacement and of the quality there."""
    stated = solution.robust
    if stated is None:
        is_due = is_finished(solution) and weighs_fragility(solution.solver.get("options", {}))
        is_due = is_due and solution.objective != "nu" and solution.mu.lower > 0.0
        return [Check.not_made("robustness", UNSTATED)] if is_due else []
    models = [model.with_friction(1.0 - stated.friction_share) for model in grasp.contacts]
    remaining = [i for i in range(len(models)) if i not in stated.lost]
    recomputed = RecomputedBounds(0.0, 0.0, unproved="no contact is left")
    if remaining:
        displaced = Grasp(
            stated.points[remaining], stated.normals[remaining], [models[i] for i in remaining], grasp.torque_origin
        )
        recomputed = recompute_mu(stated.mu, displaced, task, budget, rtol)
    displacement = float(np.max(np.linalg.norm(stated.points - grasp.points, axis=1)))
    errors = [*_robust_errors(solution, stated, budget), *_share_errors(solution, stated)]
    if not displacement <= OFFSET_FACTOR * stated.offset + 1e-9:
        errors.append("farther off than the stated offset")
    if not are_confirmed(stated.mu, recomputed):
        errors.append(unconfirmed_end(stated.mu, recomputed))
    if not (stated.mu.upper <= ZERO_SHARE * solution.mu.upper or _is_narrow(stated.mu, recomputed, ANY_GAP)):
        errors.append("wider than a certificate")
    summary = f"{len(stated.lost)} over an edge; {stated.share(solution.mu):.3g} of mu left"
    text = f"stated {stated.mu}, {recomputed.evidence}; contacts at most {1e3 * displacement:.3g} mm off; {summary}"
    return [Check.of_errors("robustness", [f"{text}: {'; '.join(errors)}"] if errors else [], text)]


def _robust_errors(solution: GraspSolution, stated: Robustness, budget: ForceBudget) -> Iterator[str]:
    """Yield errors in the stated displacement and friction loss, and in the contacts that slip over an edge."""
    options = solution.solver.get("options", {})
    for name, value in (("robust_offset", stated.offset), ("robust_friction", stated.friction_share)):
        if options.get(name, value) != value:
            yield f"{name} {options[name]:g} among the options, {value:g} stated"
    near_edges = {
        c.fingers[0] for c in solution.constraints if c.kind == EDGE_MARGIN and c.value < EDGE_SHARE * stated.offset
    }
    if set(stated.lost) != (set() if budget.depends_on_frames else near_edges):
        yield "other contacts slip over an edge"


def _share_errors(solution: GraspSolution, stated: Robustness) -> Iterator[str]:
    """Yield errors in the stated share of the quality that is left, and in whether the grasp is fragile."""
    if not stated.mu.lower <= solution.mu.upper:
        yield "more is left than there was"
    if stated.stated_share is None or not abs(stated.stated_share - stated.share(solution.mu)) <= SHARE_TOLERANCE:
        yield f"a share of {stated.stated_share} stated"
    if stated.stated_fragile is not stated.is_fragile(solution.mu):
        yield f"fragile {stated.stated_fragile} stated"


def critical_friction_checks(solution: GraspSolution, grasp: Grasp, task: Task) -> list[Check]:
    """Return the check of the stored critical friction, held at its upper end and lost at its lower one, and forces."""
    stated, holding = solution.friction, solution.holding
    if stated is None:
        return []
    errors = _critical_friction_errors(stated, holding, grasp, task)
    least = f"the least in {stated.least}" if np.isfinite(stated.least.upper) else f"none up to {LARGEST:g} is enough"
    summary = f"{least}, {holding.scope}; forces at {len(stated.curve)} others"
    return [Check.of_errors("critical friction", errors, summary)]


def _critical_friction_errors(
    stated: CriticalFriction, holding: HoldingForce, grasp: Grasp, task: Task
) -> Iterator[str]:
    """Yield errors in a stored critical friction and its curve."""
    friction, (lower, upper) = common_friction(grasp.contacts), (stated.least.lower, stated.least.upper)
    if np.isfinite(upper):
        if holding.holds(grasp.with_friction(upper / friction), task, seed=OTHER_SEED)[0] is not True:
            yield f"held above {upper:.5g} stated, not proved there"
        if upper > (1.0 + FRICTION_WIDTH) * max(lower, SMALLEST * friction):
            recomputed = holding.critical_friction(grasp, task)
            if upper > (1.0 + FRICTION_WIDTH) * recomputed.upper or recomputed.lower > (1.0 + FRICTION_WIDTH) * lower:
                yield f"{stated.least} stated, {recomputed} recomputed"
    if lower > 0.0 and holding.holds(grasp.with_friction(lower / friction), task, seed=OTHER_SEED)[0] is not False:
        yield f"lost below {lower:.5g} stated, not refuted there"
    frictions = [point.friction for point in stated.curve]
    if frictions != sorted({*frictions} - {friction}):
        yield "frictions of the curve that do not ascend, or are the contacts' own"
    for point in stated.curve:
        certify = partial(holding.least, grasp.with_friction(point.friction / friction), task, seed=OTHER_SEED)
        yield from force_errors(f"the force at {point.friction:g}", point.force, certify)


def force_errors(name: str, stated: Bounds, certify: Callable[[float], Bounds]) -> Iterator[str]:
    """Yield an error if recomputed bounds on a force do not confirm stated ones, or are much narrower.

    Parameters
    ----------
    name : str
        Shown in the message.
    stated : Bounds
    certify : callable
        Bounds on the force to a relative gap.
    """
    if stated.lower <= 0.0 and np.isfinite(stated.upper):
        yield f"{name} stated {stated}: no force is too small"
        return
    quality = stated.reciprocal()
    recomputed = recompute_bounds(quality, lambda gap: certify(gap).reciprocal(), USUAL_RTOL)
    is_narrow = (
        recomputed.lower <= (1.0 + FORCE_WIDTH) * quality.lower
        and recomputed.upper >= (1.0 - FORCE_WIDTH) * quality.upper
    )
    if not (are_confirmed(quality, recomputed) and is_narrow):
        yield f"{name} stated {stated}, recomputed {recomputed.reciprocal()}"


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
    checks = [Check("objective", agrees and is_its_task, text)]
    floor = solution.problem.get("least_mu")
    if floor is not None and solution.grasp is not None:
        checks.append(Check("floor of mu", solution.mu.lower >= floor, f"mu in {solution.mu}, at least {floor:.4g}"))
    return checks


def direction_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Return the check that the stored bounds on mu are not above the support ratio along the worst direction.

    The stated bound may be smaller, from another direction of the same solve, but never larger.
    """
    y = solution.mu.worst_direction
    if y is None:
        return []
    if y.shape != (grasp.dimension,):
        return [Check("worst direction", False, f"{y.size} numbers for dimension {grasp.dimension}")]
    ratio = support_ratio(grasp, task, force_set, y)
    if not np.isfinite(ratio):
        return [Check("worst direction", False, "the task asks for nothing in the stated direction")]
    lower, upper = solution.mu.lower, solution.mu.upper
    passed = lower <= ratio * (1.0 + 1e-6) + 1e-12 and abs(upper - ratio) <= RATIO_TOLERANCE * ratio + 1e-12
    return [Check("worst direction", passed, f"support ratio {ratio:.6g}, stated from {lower:.6g} to {upper:.6g}")]
