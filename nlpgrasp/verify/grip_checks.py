"""Checks of the grip force of parallel jaws.

The least force is one over twice mu under the shared budget, which a checker proves. In addition, the least sum of
normal forces for single wrenches of the task is computed by conic programs: no stated force may be below half of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from nlpgrasp.common.formatting import format_percent
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.confirmation import USUAL_RTOL, RecomputedBounds, are_confirmed, recompute_bounds
from nlpgrasp.quality.force_problem import LeastForces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_friction import can_press
from nlpgrasp.quality.least_grip import BUDGET
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.grip_record import FRICTION_LOSS, GripForce, read_grip
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE, patch_share
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check, NotCheckedError
from nlpgrasp.verify.proved_bounds import OTHER_SEED, prove_anew
from nlpgrasp.verify.quality_checks import FORCE_WIDTH, is_finished

DIRECTIONS = 24  # random directions whose extreme wrenches of the task are checked one by one
SAFETY_FACTOR = 1.2  # safety factor of a problem that states none
CONIC_TOLERANCE = 1e-5  # relative tolerance of a conic program's least force


def grip_checks(solution: GraspSolution, grasp: Grasp, task: Task) -> list[Check]:
    """Return the check of the stored grip force, without and with its margin; an empty list if none is stored."""
    if (solution.hand or {}).get("grip") is None:
        is_jaw = (solution.problem.get("hand") or {}).get("type") == "parallel_jaw"
        is_due = is_jaw and is_finished(solution) and solution.mu.lower > 0.0
        return [Check("grip force", False, "not stated")] if is_due else []
    stated = read_grip(solution.hand)
    if stated is None or len(grasp) != 2:
        return [Check("grip force", False, f"stated of {len(grasp)} contacts")]
    share = patch_share(solution.hand, grasp.contacts)
    if stated.holds and share < LEAST_PAD_SHARE:
        text = f"stated with {format_percent(share)} of a plane or line contact on its face"
        return [Check("grip force", False, text)]
    if share < LEAST_PAD_SHARE and stated.pad_share != share:
        text = f"a share of {stated.pad_share:.3g} of the contacts on faces stated, {share:.3g} with the pads"
        return [Check("grip force", False, text)]
    if share < LEAST_PAD_SHARE:
        return [Check("grip force", True, "none stated, as a plane or line contact is not on its face")]
    weaker = grasp.with_friction(1.0 - stated.friction_loss)
    forces = (
        ("the least force", stated.force, grasp, 1.0),
        ("the force with margin", stated.with_margin, weaker, stated.safety_factor),
    )
    errors, unproved = [*_factor_errors(solution, stated)], ""
    try:
        for name, force, grasp_alike, factor in forces:
            quality = force.reciprocal(factor)
            recomputed = recompute_bounds(quality, partial(_prove_inverse, grasp_alike, task), USUAL_RTOL)
            unproved = unproved or recomputed.unproved
            errors += _interval_errors(name, force, recomputed, grasp_alike, task, factor)
    except NotCheckedError as reason:
        return [Check.not_made("grip force", str(reason))]
    evidence = f"recomputed, not proved: {unproved}" if unproved else "proved"
    if not stated.holds:
        return [Check.of_errors("grip force", errors, f"no force holds the task, as {evidence}")]
    held = f"[{stated.force.lower:.5g}, {stated.force.upper:.5g}] N, with margin {stated.with_margin.upper:.5g} N"
    text = f"{held}, {evidence}: least, and enough for wrenches of the task one by one"
    return [Check.of_errors("grip force", errors, text)]


def _factor_errors(solution: GraspSolution, stated: GripForce) -> Iterator[str]:
    """Yield errors in the stored safety factor and friction loss."""
    hand = solution.problem.get("hand") or {}
    requested = number("problem.hand.safety_factor", hand.get("safety_factor", SAFETY_FACTOR))
    if stated.safety_factor != requested:
        yield f"a safety factor of {stated.safety_factor:g} stated, {requested:g} requested"
    if stated.friction_loss != FRICTION_LOSS:
        yield f"a friction loss of {stated.friction_loss:g} stated, {FRICTION_LOSS:g} is a solve's"


def _prove_inverse(grasp: Grasp, task: Task, rtol: float) -> RecomputedBounds:
    """Return bounds on one over the least grip force: twice mu under the shared budget, 0 where no force is known."""
    bounds = prove_anew(grasp, task, rtol, BUDGET)
    if bounds.lower <= 0.0 or not can_press(grasp):
        return replace(bounds, lower=0.0, upper=np.inf)
    return replace(bounds, lower=2.0 * bounds.lower, upper=2.0 * bounds.upper)


def _interval_errors(
    name: str, stated: Bounds, recomputed: RecomputedBounds, grasp: Grasp, task: Task, factor: float
) -> Iterator[str]:
    """Yield errors in a stored interval, newtons, of the least grip force times a factor.

    ``recomputed`` is the interval of one over the least grip force.
    """
    if stated.lower <= 0.0 and np.isfinite(stated.upper):
        yield f"{name} stated {stated}: no force is too small"
        return
    quality = stated.reciprocal(factor)
    is_narrow = (
        recomputed.lower <= (1.0 + FORCE_WIDTH) * quality.lower
        and recomputed.upper >= (1.0 - FORCE_WIDTH) * quality.upper
    )
    if not (are_confirmed(quality, recomputed) and is_narrow):
        yield f"{name} stated {stated}, recomputed {recomputed.reciprocal(factor)}"
    if not np.isfinite(stated.upper):
        return
    hardest = factor * _hardest_grip(grasp, task)
    if not hardest <= stated.upper * (1.0 + CONIC_TOLERANCE):
        yield f"{name} stated {stated.upper:.6g} N, a wrench of the task takes {hardest:.6g} N"


def _hardest_grip(grasp: Grasp, task: Task) -> float:
    """Return the largest grip force, newtons, that an extreme wrench of the task needs, by conic programs.

    Wrenches whose program the solver does not finish are left out.

    Raises
    ------
    NotCheckedError
        When it finishes none.
    """
    directions: FloatArray = np.random.default_rng(OTHER_SEED).normal(size=(DIRECTIONS, grasp.dimension))
    wrenches = np.concatenate([task.ends().reshape(-1, grasp.dimension), task.support(directions)[1]])
    wrench_set = WrenchSet.of(grasp, BUDGET)
    forces = LeastForces(wrench_set).solve(wrenches)[0]
    solved = np.all(np.isfinite(forces), axis=1)
    if not solved.any():
        raise NotCheckedError("the solver finished no conic program of the task's wrenches")
    return 0.5 * float(np.max(wrench_set.force_set.gauge(forces[solved]), initial=0.0))
