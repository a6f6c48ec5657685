"""Checks of the finger forces in a file: for the scaled task, for the task at full size, and of the squeeze.

Forces are inserted into the equilibrium equations and the contacts' cones (``force_residuals``).

That forces for the task at its full size are least is proved by weak duality: for any direction y of wrench space,
forces that produce w use at least ``<w, y> / phi(y)`` of the budget, phi the support function of the wrenches of one
unit. The proof does not depend on the conic program that proposes y.

Joint torques of a squeeze come from virtual work with the Jacobians of this package's own kinematics. That no other
forces need less friction is not checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.optimize import linprog

from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.quality.force_problem import LeastForces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.other_measures import pyramid_wrenches
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.force_records import ForcesNeeded
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope
from nlpgrasp.verify.check import Check, NotCheckedError
from nlpgrasp.verify.joint_checks import JACOBIAN_TOLERANCE
from nlpgrasp.verify.numeric_urdf_hand import require_links
from nlpgrasp.verify.quality_checks import is_finished
from nlpgrasp.verify.stated_placement import NumericHand

FORCE_TOLERANCE = 1e-6  # relative tolerance of balance, cones and budget
DIRECTIONS = 500  # directions in which a wrench is compared with the task's support
LEAST_FORCE_TOLERANCE = 1e-6  # relative tolerance of forces over the least ones, as conic programs may end at 3e-8
DERIVED_TOLERANCE = 1e-9  # relative tolerance of numbers that follow from others in the file
EDGES = 24  # edges of a friction pyramid
REFUTING_SHARE = 0.98  # share of the friction that a refuting squeeze may use
INFEASIBLE = 2  # HiGHS status
FRICTION_TOLERANCE = 1e-3  # relative tolerance of the share of friction
LEAST_FRICTION_SHARE = 1e-5  # smaller shares of friction count as none


def force_checks(solution: GraspSolution, grasp: Grasp, force_set: ForceSet) -> list[Check]:
    """Return the check that stored finger forces produce their wrenches within the friction cones and the budget."""
    if not solution.forces:
        return []
    k, space, d = len(grasp), grasp.space, grasp.dimension
    worst_balance = worst_cone = largest_use = 0.0
    for i, (wrench, forces) in enumerate(solution.forces):
        moments = solution.moments[i] if len(solution.moments) else np.zeros((k, d - space))
        if forces.shape != (k, space) or moments.shape != (k, d - space) or wrench.shape != (d,):
            return [Check("forces", False, f"shapes {forces.shape} and {moments.shape} for {k} contacts")]
        balance, cone, used = force_residuals(grasp, force_set, wrench, forces, moments)
        worst_balance, worst_cone, largest_use = (
            max(worst_balance, balance),
            max(worst_cone, cone),
            max(largest_use, used),
        )
    passed = worst_balance <= FORCE_TOLERANCE and worst_cone <= FORCE_TOLERANCE and largest_use <= 1.0 + FORCE_TOLERANCE
    residuals = f"relative residual {worst_balance:.1e}, distance to the cones {worst_cone:.1e}"
    return [
        Check("forces", passed, f"{len(solution.forces)} wrenches, {residuals}, {largest_use:.4g} of the force budget")
    ]


def force_residuals(
    grasp: Grasp, force_set: ForceSet, wrench: FloatArray, forces: FloatArray, moments: FloatArray
) -> tuple[float, float, float]:
    """Return equilibrium residual, distance from the friction cones and used budget of finger forces.

    The forces (k, space) and moments (k, d - space) are to produce the wrench (d,).

    Returns
    -------
    balance, cone, used : float
        Both distances relative to the forces, and the used share of the force budget.
    """
    space, d = grasp.space, grasp.dimension
    total = np.concatenate([forces.sum(axis=0), _moments(grasp, forces) + moments.sum(axis=0)])
    arm = max(float(np.max(np.abs(grasp.points - grasp.torque_origin))), 1e-300)
    weights = np.concatenate([np.ones(space), np.full(d - space, 1.0 / arm)])
    scale = max(float(np.linalg.norm(forces)), float(np.linalg.norm(moments)) / arm, 1e-300)
    balance, cone = float(np.linalg.norm((total - wrench) * weights)) / scale, 0.0
    components_of_contacts = []
    for force, moment, frame, model in zip(forces, moments, grasp.frames, grasp.contacts, strict=True):
        local = np.concatenate([frame.T @ force, frame.T @ moment if space == 3 else moment])
        projected = np.zeros(d)
        components = model.project(local[None, list(model.axes(space))])[0]
        projected[list(model.axes(space))] = components
        components_of_contacts.append(components)
        cone = max(cone, float(np.linalg.norm(local - projected)) / scale)
    return balance, cone, float(force_set.gauge(np.concatenate(components_of_contacts)[None, :])[0])


def _moments(grasp: Grasp, forces: FloatArray) -> FloatArray:
    """Return the total moment of forces (k, space) at the contacts about the torque origin, (1,) or (3,)."""
    arms = grasp.points - grasp.torque_origin
    if grasp.space == 2:
        return np.array([np.sum(arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0])])
    return np.asarray(np.sum(np.cross(arms, forces), axis=0))


def wrench_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Return the check that stored forces are for the extreme wrenches of the task scaled by the lower bound on mu."""
    factor, name = solution.mu.lower, "wrenches"
    if not solution.forces:
        if factor <= 0.0 or not len(task.ends()):
            return []
        if not solution.starts:  # a continuation step: its file claims no forces
            return [Check.not_made(name, "the file states no finger forces")]
        return [Check(name, False, "no finger forces for any of the task's wrenches")]
    wrenches = np.array([wrench for wrench, _ in solution.forces])
    if wrenches.shape[1:] != (grasp.dimension,):
        return [Check(name, False, f"shape {wrenches.shape} for dimension {grasp.dimension}")]
    errors = list(_listing_errors(grasp, task, force_set, wrenches, factor))
    return [Check.of_errors(name, errors, f"{len(wrenches)} of the task's, times {factor:.6g}")]


def _listing_errors(
    grasp: Grasp, task: Task, force_set: ForceSet, wrenches: FloatArray, factor: float
) -> Iterator[str]:
    """Yield errors in the wrenches (m, d) with stated forces: they are the task's extreme ones, each once, in order.

    Only those are left out whose conic program has no solution here either. For tasks whose extreme wrenches are not
    listed in them, all have to be within the scaled task and not zero.
    """
    tolerances, ends = FORCE_TOLERANCE * np.linalg.norm(wrenches, axis=1), factor * task.ends()
    is_listed = isinstance(task, TaskEllipsoid) or (isinstance(task, TaskPolytope) and len(ends) == len(task.wrenches))
    if not is_listed:
        directions = _unit_rows(_random_directions(wrenches.shape[1]))
        excess = np.max(wrenches @ directions.T - factor * task.support(directions)[0], axis=1)
        if not np.all((excess <= tolerances) & (tolerances > 0.0)):
            yield f"wrench {int(np.argmax(excess - tolerances))} is not within the task times the stated lower bound"
        return
    listed, omitted = 0, list[int]()
    for i, end in enumerate(ends):
        is_next = listed < len(wrenches) and np.linalg.norm(wrenches[listed] - end) <= tolerances[listed]
        listed += bool(is_next)
        omitted += [] if is_next else [i]
    if listed < len(wrenches):
        yield f"wrench {listed} is not the stated lower bound times the next one that the task asks for"
    elif omitted and factor > 0.0:
        forces = LeastForces(WrenchSet(grasp.G, force_set)).solve(ends[omitted])[0]
        if np.any(np.all(np.isfinite(forces), axis=1)):
            yield f"no forces for {len(omitted)} of {len(ends)} wrenches that the task asks for"


def _random_directions(dimension: int) -> FloatArray:
    """Return random directions of wrench space, (n, d), normally distributed, from a fixed seed."""
    return np.random.default_rng(0).normal(size=(DIRECTIONS, dimension))


def _unit_rows(vectors: FloatArray) -> FloatArray:
    """Return vectors (n, d) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def needed_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Return the check of the stored finger forces for the task at full size."""
    stated = solution.needed
    if stated is None:
        is_due = is_finished(solution) and solution.mu.lower > 0.0
        return [Check("forces needed", False, "not stated")] if is_due else []
    k, space, d = len(grasp), grasp.space, grasp.dimension
    moments = np.zeros((k, d - space)) if stated.moments is None else stated.moments
    shapes = [(stated.wrench, (d,)), (stated.forces, (k, space)), (moments, (k, d - space))]
    shapes += [(values, (k,)) for values in (stated.normal, stated.size, stated.largest)]
    if any(stated_array.shape != shape for stated_array, shape in shapes):
        return [Check("forces needed", False, f"shapes that are not those of {k} contacts")]
    budget_bounds = _BudgetBounds(grasp, force_set)
    balance, cone, used = force_residuals(grasp, force_set, stated.wrench, stated.forces, moments)
    errors = [
        *_wrench_errors(solution, stated.wrench, task, budget_bounds, used),
        *_derived_errors(solution, grasp, task, stated),
    ]
    if not (balance <= FORCE_TOLERANCE and cone <= FORCE_TOLERANCE):
        errors.append(f"relative residual {balance:.1e}, distance to the cones {cone:.1e}")
    errors += _force_excesses(solution, stated.wrench, grasp, force_set, budget_bounds, used)
    is_above = stated.is_within(solution.finger_limit) is False
    excess_text = f", ABOVE max_force = {solution.max_force:g} N" if is_above else ""
    largest = f"largest {float(np.max(stated.largest)):.6g} N{excess_text}"
    summary = f"{largest}, together {stated.total:.6g} N, of the budget {used:.6g}"
    return [Check.of_errors("forces needed", errors, f"{summary}: least, and in the cones")]


def _wrench_errors(
    solution: GraspSolution, wrench: FloatArray, task: Task, budget_bounds: _BudgetBounds, used: float
) -> Iterator[str]:
    """Yield an error if the stored hardest wrench is outside the task, or another one needs a larger budget."""
    y = solution.mu.worst_direction
    if not _is_in_task(task, wrench):
        yield "a wrench that the task does not ask for"
    examined = task.ends() if y is None else np.concatenate([task.ends(), task.support(y[None])[1]])
    hardest = float(np.max(budget_bounds(examined), initial=0.0))
    if not hardest <= used * (1.0 + LEAST_FORCE_TOLERANCE):
        yield f"a wrench that takes {used:.6g} of the budget, another of the task takes {hardest:.6g}"


def _is_in_task(task: Task, wrench: FloatArray) -> bool:
    """Return whether a wrench (d,) is in the task.

    By coordinates for an ellipsoid, by sampled directions for other tasks.
    """
    tolerance = FORCE_TOLERANCE * max(float(np.linalg.norm(wrench)), 1e-300)
    if isinstance(task, TaskEllipsoid):
        coordinates = np.linalg.lstsq(task.axes.T, wrench - task.center, rcond=None)[0]
        distance = float(np.linalg.norm(task.center + coordinates @ task.axes - wrench))
        return bool(distance <= tolerance and np.linalg.norm(coordinates) <= 1.0 + FORCE_TOLERANCE)
    directions = _unit_rows(np.concatenate([_random_directions(len(wrench)), [wrench]]))
    return bool(np.all(directions @ wrench <= task.support(directions)[0] + tolerance))


def _derived_errors(solution: GraspSolution, grasp: Grasp, task: Task, stated: ForcesNeeded) -> Iterator[str]:
    """Yield errors in numbers that have to follow from the stored forces, mu and the force limit.

    If the file omits forces of some extreme wrenches, the largest ones may belong to those.
    """
    size, mu = np.linalg.norm(stated.forces, axis=1), solution.mu.lower
    scale = max(float(np.max(size)), 1e-300)
    # the solution's forces hold mu times the extreme wrenches
    scaled_sizes = [np.linalg.norm(forces, axis=1) / mu for _, forces in solution.forces] if mu > 0.0 else []
    largest = np.max([size, *scaled_sizes], axis=0)
    pairs = {
        "normal forces": (stated.normal, np.sum(stated.forces * grasp.normals, axis=1)),
        "sizes of the forces": (stated.size, size),
    }
    if len(solution.forces) >= len(task.ends()):
        pairs["largest forces"] = (stated.largest, largest)
    elif np.any(stated.largest < largest * (1.0 - DERIVED_TOLERANCE)):
        yield "largest forces below those of the stated forces"
    for name, (stated_values, derived) in pairs.items():  # not <=: also of NaN
        if not np.max(np.abs(stated_values - derived)) <= DERIVED_TOLERANCE * max(scale, float(np.max(largest))):
            yield f"{name} that are not those of the stated forces"
    # the file's own summary, if it has one, and the one derived from its fingers
    if not np.allclose(stated.stated_summary or stated.summary, stated.summary, rtol=DERIVED_TOLERANCE, atol=0.0):
        yield "a largest force, its finger or a total that is not that of the fingers"
    bounds = [1.0 / solution.mu.upper, 1.0 / mu if mu > 0.0 else np.inf]
    if not np.allclose([stated.budget.lower, stated.budget.upper], bounds, rtol=DERIVED_TOLERANCE, atol=0.0):
        yield f"{stated.budget} of the budget, 1 / mu is in [{bounds[0]:.5g}, {bounds[1]:.5g}]"
    if stated.within != stated.is_within(solution.finger_limit):
        yield f"within the limit of {solution.finger_limit}: {stated.within}"


def _force_excesses(
    solution: GraspSolution,
    wrench: FloatArray,
    grasp: Grasp,
    force_set: ForceSet,
    budget_bounds: _BudgetBounds,
    used: float,
) -> Iterator[str]:
    """Yield an error if stored forces use a larger budget than the least forces for their wrench."""
    least = float(budget_bounds(wrench[None])[0])
    if not used <= least * (1.0 + LEAST_FORCE_TOLERANCE):
        yield f"{used:.6g} of the budget, where {least:.6g} is enough"
    if not solution.forces:
        return
    no_moments = np.zeros((len(grasp), grasp.dimension - grasp.space))
    moments = solution.moments if len(solution.moments) else [no_moments] * len(solution.forces)
    wrenches = np.array([wrench for wrench, _ in solution.forces])
    uses = [force_residuals(grasp, force_set, w, f, m)[2] for (w, f), m in zip(solution.forces, moments, strict=True)]
    excess = np.array(uses) - budget_bounds(wrenches) * (1.0 + LEAST_FORCE_TOLERANCE)
    if not np.all(excess <= 0.0):
        worst = int(np.argmax(excess))
        yield f"forces {worst} take {excess[worst]:.2g} of the budget more than they have to"


class _BudgetBounds:
    """Lower bounds on the force budget that wrenches need, each proved by a direction of wrench space."""

    def __init__(self, grasp: Grasp, force_set: ForceSet) -> None:
        arms = np.linalg.norm(grasp.points - grasp.torque_origin, axis=1)
        scale = np.ones(grasp.dimension)
        scale[grasp.space :] = float(np.max(arms)) or 1.0
        self._units, self._set = scale, WrenchSet(grasp.G / scale[:, None], force_set)

    def __call__(self, wrenches: FloatArray) -> FloatArray:
        """Return lower bounds on the budget that wrenches (m, d) need, (m,); 0 if no direction proves more."""
        scaled = wrenches / self._units
        size = np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
        scaled /= size[:, None]
        directions = LeastForces(self._set).solve(scaled)[1]
        directions[~np.all(np.isfinite(directions), axis=1)] = 0.0
        reach = self._set.support(directions)[0]
        work = np.sum(scaled * directions, axis=1)
        return np.asarray(np.where(reach > 0.0, work / np.where(reach > 0.0, reach, 1.0), 0.0) * size)


def squeeze_checks(solution: GraspSolution, grasp: Grasp, hand: NumericHand | None) -> list[Check]:
    """Return the checks of the stored squeeze: its forces, friction, joint torques and position commands."""
    posture = solution.hand or {}
    stated = posture.get("squeeze")
    if "no_squeeze" in posture:
        try:
            error = _no_squeeze_error(grasp) if stated is None else "states a squeeze, and that there is none"
        except NotCheckedError as reason:
            return [Check.not_made("squeeze", str(reason))]
        return [Check.of_errors("squeeze", [error], "none: no forces that balance press at every contact")]
    if stated is None:
        return _unstated_squeeze_checks(solution, grasp)
    errors = list(_force_errors(stated, grasp))
    summary = f"friction {stated['friction_needed']:.4g} needed, {stated['share']:.4g} of what there is"
    checks = [Check.of_errors("squeeze", errors, summary)]
    if "torques" not in stated:
        return checks
    try:
        errors = list(_joint_errors(stated, solution, grasp, hand))
    except NotCheckedError as reason:
        return [*checks, Check.not_made("squeeze torques", str(reason))]
    return [
        *checks,
        Check.of_errors("squeeze torques", errors, f"of {len(stated['torques'])} joints, by virtual work"),
    ]


def _unstated_squeeze_checks(solution: GraspSolution, grasp: Grasp) -> list[Check]:
    """Return a failed check if a solve with a hand with joints conceals that there is no squeeze."""
    if (solution.problem.get("hand") or {}).get("type") != "urdf" or not is_finished(solution):
        return []
    try:
        is_concealed = not _no_squeeze_error(grasp)
    except NotCheckedError as reason:
        return [Check.not_made("squeeze", str(reason))]
    message = "not stated, nor that no forces that balance press at every contact"
    return [Check("squeeze", False, message)] if is_concealed else []


def _no_squeeze_error(grasp: Grasp) -> str:
    """Return an error text if balanced forces that press at every contact exist although the file denies it.

    Balanced forces on the edges of friction pyramids inside the cones, with a normal force at every contact, would
    refute it: a linear program, by HiGHS.
    """
    try:
        edges = pyramid_wrenches(
            grasp.with_friction(REFUTING_SHARE),
            EDGES,
            grasp.mean_arm,
        )
    except InputError as error:
        raise NotCheckedError(str(error)) from None
    normal_force_rows = np.zeros((len(grasp), sum(map(len, edges))))
    for i, last_column in enumerate(np.cumsum([len(contact_edges) for contact_edges in edges])):
        normal_force_rows[i, last_column - len(edges[i]) : last_column] = -1.0
    balance, least_normal_forces = np.concatenate(edges).T, -np.ones(len(grasp))
    program = linprog(
        np.ones(normal_force_rows.shape[1]),
        normal_force_rows,
        least_normal_forces,
        balance,
        np.zeros(len(balance)),
        method="highs",
    )
    if program.status == INFEASIBLE:
        return ""
    return "states that there is none, but forces that balance press at every contact"


def _force_errors(stated: Json, grasp: Grasp) -> Iterator[str]:
    """Yield errors in the finger forces of a squeeze."""
    k, space, d = len(grasp), grasp.space, grasp.dimension
    fingers, wrench = stated["fingers"], array("wrench", stated["wrench"], (d,))
    forces = array("force", [f["force"] for f in fingers], (k, space))
    moments = array("moment", [f.get("moment", [0.0] * (d - space)) for f in fingers], (k, d - space))
    balance, cone, _ = force_residuals(grasp, L2Set(grasp.contacts, space), wrench, forces, moments)
    if not (balance <= FORCE_TOLERANCE and cone <= FORCE_TOLERANCE):
        yield f"forces {balance:.1e} off balance and {cone:.1e} off their cones, relative to them"
    if not abs(stated["residual"] - balance) <= FORCE_TOLERANCE:
        yield f"residual {stated['residual']:.1e} stated, {balance:.1e} found"
    normal = np.sum(forces * grasp.normals, axis=1)
    friction = np.linalg.norm(forces - normal[:, None] * grasp.normals, axis=1) / normal
    for i, finger in enumerate(fingers):
        if not normal[i] >= stated["normal_force"] * (1.0 - JACOBIAN_TOLERANCE):
            yield f"finger {i} presses with {normal[i]:.4g} N, less than {stated['normal_force']:.4g} N"
        if not (_agrees(finger["normal"], normal[i]) and _agrees(finger["friction"], friction[i], 1.0)):
            yield f"finger {i} states another normal force or friction than its force has"
    if not _agrees(stated["friction_needed"], float(np.max(friction)), 1.0):
        yield f"friction {stated['friction_needed']:.4g} stated as needed, {np.max(friction):.4g} found"
    yield from _friction_use_errors(stated["share"], grasp, wrench, forces, moments)


def _friction_use_errors(
    friction_fraction: float, grasp: Grasp, wrench: FloatArray, forces: FloatArray, moments: FloatArray
) -> Iterator[str]:
    """Yield an error if the forces use a fraction of the friction other than the stored one."""

    def cone_distance(friction_share: float) -> float:
        scaled_grasp = grasp.with_friction(friction_share)
        return force_residuals(scaled_grasp, L2Set(scaled_grasp.contacts, grasp.space), wrench, forces, moments)[1]

    sufficient = max(friction_fraction, 0.0) + LEAST_FRICTION_SHARE
    if not cone_distance(sufficient) <= FORCE_TOLERANCE:
        yield f"the forces need more than a share of {friction_fraction:.4g} of the friction"
    insufficient = (1.0 - FRICTION_TOLERANCE) * friction_fraction - 2.0 * LEAST_FRICTION_SHARE
    if insufficient > 0.0 and not cone_distance(insufficient) > 0.0:
        yield f"the forces need less than a share of {friction_fraction:.4g} of the friction"


def _joint_errors(stated: Json, solution: GraspSolution, grasp: Grasp, hand: NumericHand | None) -> Iterator[str]:
    """Yield errors in a squeeze's joint torques, Jacobians, most loaded joint and position commands."""
    linked_hand = require_links(hand, "Jacobians")
    hand_jacobians, torques = linked_hand.contact_jacobians(grasp.points), stated["torques"]
    if list(torques) != list(hand_jacobians):
        yield f"torques of {', '.join(torques)}, where {', '.join(hand_jacobians)} move the contacts"
        return
    sliding = [joint for joint in torques if linked_hand.ranges[joint][2]]
    if list(stated.get("sliding", ())) != sliding:
        yield f"{', '.join(sliding) or 'no joints'} slide, stated {', '.join(stated.get('sliding', ())) or 'none'}"
    forces = np.array([[*f["force"], *f.get("moment", [0.0] * 3)] for f in stated["fingers"]], dtype=float)
    size = float(np.max(np.linalg.norm(forces[:, :3], axis=1)))
    tolerance = JACOBIAN_TOLERANCE + linked_hand.direction_error
    jacobians = array("jacobians", stated["jacobians"], (len(grasp), 6, len(hand_jacobians)))
    for j, (joint, J) in enumerate(hand_jacobians.items()):  # J (k, 6): velocities of the contacts
        largest_entry = max(1.0, float(np.max(np.abs(J))))
        if not np.max(np.abs(jacobians[:, :, j] - J)) <= tolerance * largest_entry:  # also for NaN
            yield f"Jacobian of joint {joint} is not that of the hand in its posture"
        torque = float(np.sum(J * forces))
        if not abs(torques[joint] - torque) <= tolerance * size * largest_entry:
            yield f"joint {joint} needs {torque:.4g}, stated {torques[joint]:.4g}"
    limits = linked_hand.data.get("torque_limits") or {}
    ratios = {joint: abs(torques[joint]) / limits[joint] for joint in hand_jacobians if joint in limits}
    worst_joint, largest_ratio = stated.get("worst_joint"), max(ratios.values(), default=None)
    if (largest_ratio is None) != (worst_joint is None) or (
        largest_ratio is not None and not _agrees(stated["worst_share"], largest_ratio)
    ):
        yield f"the worst joint's share of its torque limit is {largest_ratio}, stated {stated.get('worst_share')}"
    # of joints with equal ratios each may be stated as the worst
    elif worst_joint is not None and not (worst_joint in ratios and _agrees(ratios[worst_joint], largest_ratio)):
        yield f"joint {worst_joint} is not the worst"
    yield from _command_errors(stated, solution)


def _command_errors(stated: Json, solution: GraspSolution) -> Iterator[str]:
    """Yield errors in position commands, which have to be the grasp's positions plus torque over gain."""
    if "gain" not in stated:
        return
    gain, positions, commands = stated["gain"], (solution.hand or {})["joint_positions"], stated["positions"]
    if set(commands) != set(stated["torques"]):
        yield "positions of other joints than torques"
        return
    for joint, torque in stated["torques"].items():
        command = positions[joint] + torque / (gain[joint] if isinstance(gain, Mapping) else gain)
        if not _agrees(commands[joint], command, 1.0):
            yield f"the command of joint {joint} is {command:.6g}, stated {commands[joint]:.6g}"


def _agrees(stated: float, recomputed: float | None, least_scale: float = 0.0) -> bool:
    """Return whether a stored number agrees with the recomputed one, within a relative tolerance."""
    return recomputed is not None and abs(stated - recomputed) <= JACOBIAN_TOLERANCE * max(abs(recomputed), least_scale)
