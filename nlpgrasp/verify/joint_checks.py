"""Checks of joint-limit margins and joint-torque budgets in the posture of the grasp.

Joint ranges come from the hand's file, by this package's own kinematics. That no posture has larger margins at the
same price is not checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotCheckedError
from nlpgrasp.verify.numeric_hands import FreeHand
from nlpgrasp.verify.numeric_urdf_hand import NumericLinkedHand, require_links
from nlpgrasp.verify.quality_checks import is_finished
from nlpgrasp.verify.stated_placement import NumericHand

MARGIN_TOLERANCE = 1e-9  # relative tolerance of the price of margins
LARGEST_MARGIN_SHARE = 0.1  # largest margin, as a share of a joint's range
LIMIT_TOLERANCE = 1e-6  # relative tolerance up to which a joint has its margin
STATED_TOLERANCE = 1e-6  # tolerance of a stated margin or distance from a limit, relative to the margin
JACOBIAN_TOLERANCE = 1e-6  # relative tolerance of recomputed Jacobians
JOINT_BUDGETS = ("joint_torques", "shared_joint_torques")  # force budgets of joint torques


def joint_margin_checks(solution: GraspSolution, hand: NumericHand | None) -> list[Check]:
    """Return the checks of the stored joint-limit margins, ``hand.room``."""
    stated, options = (solution.hand or {}).get("room"), solution.solver.get("options", {})
    if stated is None:
        is_urdf = (solution.problem.get("hand") or {}).get("type") == "urdf"
        is_due = is_urdf and is_finished(solution) and options.get("joint_margin", 0.0) > 0.0 and not options.get("gap")
        return [Check("room of joints", False, "not stated")] if is_due else []
    errors = list(_price_errors(stated, solution))
    summary = f"{stated['cost']:.2%} of mu, " if "cost" in stated else ""
    checks = [Check.of_errors("price of room", errors, f"{summary}{stated['price']:.2%} allowed")]
    try:
        errors = list(_margin_errors(stated, solution, hand))
    except NotCheckedError as reason:
        return [*checks, Check.not_made("room of joints", str(reason))]
    summary = f"{len(stated['margins'])} joints, {len(stated['near'])} near a limit"
    return [*checks, Check.of_errors("room of joints", errors, summary)]


def _price_errors(stated: Json, solution: GraspSolution) -> Iterator[str]:
    """Yield errors if the stored margin, or the fraction of mu allowed for it, differs from the solver's options.

    In files of earlier versions, which state the cost: another cost, or more than the price allows.
    """
    price, margin = number("hand.room.price", stated["price"], at_least=0.0), stated["margin"]
    options, mu_without = solution.solver.get("options", {}), stated.get("mu_without")
    for name, value in (("room_price", price), ("joint_margin", margin)):
        if options.get(name, value) != value:
            yield f"{name} {options[name]} among the options, {value} stated"
    if mu_without is None:
        return
    low, high = (number(f"hand.room.mu_without.{end}", mu_without[end], above=0.0) for end in ("lower", "upper"))
    winner = solution.winner
    if winner is None:
        return
    if not (
        winner.mu.lower >= (1.0 - price - MARGIN_TOLERANCE) * low
        and winner.mu.upper >= (1.0 - price - MARGIN_TOLERANCE) * high
    ):
        yield f"mu in {winner.mu} is more than {price:.2%} below [{low:.4f}, {high:.4f}], which is without room"
    if not abs(stated["cost"] - (1.0 - winner.mu.upper / high)) <= MARGIN_TOLERANCE:
        yield f"it took {1.0 - winner.mu.upper / high:.2%} of mu, stated {stated['cost']:.2%}"


def _margin_errors(stated: Json, solution: GraspSolution, hand: NumericHand | None) -> Iterator[str]:
    """Yield errors in the stored margins of joints and in their distances from their limits."""
    margins, near, margin = stated["margins"], stated["near"], number("hand.room.margin", stated["margin"], above=0.0)
    ranges, positions = require_links(hand, "joints").ranges, (solution.hand or {})["joint_positions"]
    if set(margins) != set(ranges) or not set(near) <= set(ranges):
        raise InputError("hand.room.margins", ", ".join(margins), ", ".join(ranges))
    for joint, (lower, upper, slides) in ranges.items():
        required = (
            LARGEST_MARGIN_SHARE * (upper - lower) if slides else min(margin, LARGEST_MARGIN_SHARE * (upper - lower))
        )
        distance = min(positions[joint] - lower, upper - positions[joint])
        if not abs(margins[joint] - required) <= STATED_TOLERANCE * required:
            yield f"joint {joint} is to have {required:.4g}, stated {margins[joint]:.4g}"
        if joint in near and not abs(near[joint] - distance) <= STATED_TOLERANCE * required:
            yield f"joint {joint} is {distance:.4g} from a limit, stated {near[joint]:.4g}"
        if joint not in near and not distance >= (1.0 - 2.0 * LIMIT_TOLERANCE) * required:
            yield f"joint {joint} is {distance:.4g} from a limit, and not named"
        if joint in near and not distance <= required:
            yield f"joint {joint} is named and has its margin"


def torque_checks(solution: GraspSolution, grasp: Grasp, hand: NumericHand | None) -> list[Check]:
    """Return the checks that a joint-torque budget has the Jacobians and torque limits of the hand.

    Files state a hand's torque limits as ``shared_joint_torques`` in the solution's posture. Without a hand, Jacobians
    are the problem's own.
    """
    budget = solution.problem["force_budget"]
    if not isinstance(budget, Mapping) or budget.get("type") not in JOINT_BUDGETS:
        return []
    try:
        return _compare_budget(budget, grasp, hand)
    except NotCheckedError as reason:
        return [Check.not_made("joint torques", str(reason))]


def _compare_budget(budget: Json, grasp: Grasp, hand: NumericHand | None) -> list[Check]:
    """Return the checks that compare a budget's Jacobians and torque limits with those of the hand."""
    if hand is None or isinstance(hand, FreeHand):
        raise NotCheckedError("no hand moves the contacts: the Jacobians are the problem's own")
    linked_hand = require_links(hand, "Jacobians")
    if budget["type"] != "shared_joint_torques":
        return [Check("joint torques", False, "each contact has joints of its own, where the hand's are common to all")]
    jacobians = linked_hand.contact_jacobians(grasp.points)
    stated_limits = np.array([linked_hand.data["torque_limits"][joint] for joint in jacobians], dtype=float)
    limits = array("limits", budget["limits"], (len(jacobians),))
    number("force_limit", budget["force_limit"], above=0.0)
    error = _jacobian_difference(budget["jacobians"], jacobians, linked_hand.direction_error)
    if not np.array_equal(limits, stated_limits):
        joint = list(jacobians)[int(np.argmax(limits != stated_limits))]
        error = f"another limit for joint {joint} than problem.hand.torque_limits states"
    summary = f"Jacobians of {len(grasp)} contacts and limits of {len(jacobians)} joints"
    return [Check.of_errors("joint torques", [error], summary), _effort_check(linked_hand, list(jacobians))]


def _jacobian_difference(stated: object, recomputed: Mapping[str, FloatArray], turn: float) -> str:
    """Return a message if stored Jacobians differ from recomputed ones, or an empty text if they agree."""
    expected_jacobians = np.stack(list(recomputed.values()), axis=2)  # (k, 6, m)
    for i, (J, expected) in enumerate(
        zip(_jacobian_list(stated, len(expected_jacobians)), expected_jacobians, strict=True)
    ):
        stated_jacobian = array(f"jacobians[{i}]", J, (None, expected_jacobians.shape[2]))
        if len(stated_jacobian) not in (3, 6):
            return f"Jacobian {i} has {len(stated_jacobian)} rows"
        difference = float(np.max(np.abs(stated_jacobian - expected[: len(stated_jacobian)])))
        if not difference <= (JACOBIAN_TOLERANCE + turn) * max(1.0, float(np.max(np.abs(expected)))):
            return f"Jacobian {i} is {difference:.2g} off that of the hand in its posture"
    return ""


def _jacobian_list(stated: object, count: int) -> Sequence[object]:
    """Return a file's list of Jacobians, checked to have ``count`` entries."""
    if not isinstance(stated, Sequence) or len(stated) != count:
        raise ValueError(f"not {count} Jacobians")
    return stated


def _effort_check(hand: NumericLinkedHand, joints: Sequence[str]) -> Check:
    """Return the check that a hand's torque limits are the effort limits in its URDF.

    Users may have given others; then the check is not made.
    """
    efforts = {link.joint: link.effort for link in hand.links}
    other_joints = [joint for joint in joints if hand.data["torque_limits"][joint] != efforts[joint]]
    if other_joints:
        return Check.not_made(
            "torque limits", f"those of {', '.join(other_joints)} are the problem's own, not the URDF's"
        )
    return Check("torque limits", True, f"of {len(joints)} joints, the URDF's efforts")
