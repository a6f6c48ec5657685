"""Inverse kinematics of one finger while palm and other fingers are fixed, and diagnosis of obstructions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.common.quadratic_program import Linearised, NewtonRules, restore_feasibility, step_bounds
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.tips import SymbolicTouch
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.contact_path import LIFTED, SLIDING, TargetContact

TOLERANCE = 1e-6  # share of the body's size, and radians: tolerance of a reached contact
NEWTON_RULES = NewtonRules(steps=15, enough=TOLERANCE)  # with joint limits and clearances
FREE_STEPS = 6  # before these, on the contact's equations alone, at most
MAX_STEP = 0.2  # radians (metres for sliding joints, tip coordinates): largest Newton step
CRITICAL_SHARE = 0.1  # share of the hand's span: clearances below this enter the steps
DIFFERENCE = 1e-4  # radians or metres: step of finite differences
NO_LIMIT = 1e3  # joint limits that never bind


@dataclass(frozen=True)
class KinematicsResult:
    """Result of the inverse kinematics of a finger: variables and residual.

    Parameters
    ----------
    values : dict
        Of the hand's variables.
    residual : float
        Residual of the fingertip at its contact, shares of the body's size and radians.
    """

    values: Values
    residual: float

    @property
    def is_reached(self) -> bool:
        """Whether the fingertip is at its target contact, within tolerance."""
        return self.residual <= TOLERANCE


class FingerJoints:
    """Inverse kinematics of one finger by Newton's method with joint limits and clearances.

    Each Newton step is the shortest that keeps joint limits, places the fingertip to first order, and keeps the
    critical clearances: redundant joints avoid collisions. A joint that also moves another finger's contact stays
    fixed.

    Parameters
    ----------
    hand : URDFHand
    finger : int
    surroundings : HandClearance
    size : float
        The body's, metres.

    Attributes
    ----------
    joint_indices : (m,) int array
        Indices of its free joints.
    """

    def __init__(self, hand: URDFHand, finger: int, surroundings: HandClearance, size: float) -> None:
        self.hand, self.finger, self.size = hand, finger, size
        robot = hand.robot
        if hand.closed_linkages:
            given = f"a hand with closed linkages ({hand.closed_linkages[0]})"
            raise InputError("GraspProblem.hand", given, "a hand whose fingers move by joints of their own")
        moving_joints = [{robot.driving_joint(j)[0] for j in robot.chain(link) if j.moves} for link, _ in hand.tips]
        others = set().union(*(names for i, names in enumerate(moving_joints) if i != finger))
        names = moving_joints[finger] - others
        self.joint_indices = np.array([i for i, j in enumerate(robot.free_joints) if j.name in names], int)
        self.model = surroundings.for_joints(self.joint_indices)
        limits = hand.tree.joint_limits[:, self.joint_indices]
        tip = hand.tips[finger][1]
        self.slide = sum(t.slides for _, t in hand.tips[:finger]) if tip.slides else None
        slide_limits = [] if self.slide is None else [1.0]
        self.limits = np.concatenate([limits[0], [0.0] * len(slide_limits)]), np.concatenate([limits[1], slide_limits])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that move this finger alone."""
        return tuple(self.hand.robot.free_joints[i].name for i in self.joint_indices)

    def reach(
        self, values: Values, target: TargetContact, clearance_limits: FloatArray | None, *, limited: bool = True
    ) -> KinematicsResult:
        """Return the finger's joint positions, near the initial ones, that put its fingertip at a target contact.

        Clearances enter the Newton steps only if they are violated without.

        Parameters
        ----------
        values : dict
            Initial values of the hand's variables.
        target : TargetContact
        clearance_limits : (n,) array or None
            Lower limits of the clearances, metres; None to ignore them.
        limited : bool
            Whether to keep joint limits.
        """
        result = self._shortest_steps(values, target) or self._newton(values, target, None, limited)
        if clearance_limits is None or (
            result.is_reached and np.all(self.model.clearances(result.values) >= clearance_limits)
        ):
            return result
        return self._newton(values, target, clearance_limits, limited)

    def _shortest_steps(self, values: Values, target: TargetContact) -> KinematicsResult | None:
        """Return the result of minimum-norm Newton steps without inequalities; None if a limit is violated."""
        z = self._finger_variables(values)
        for _ in range(FREE_STEPS):
            candidate = self._replace_variables(values, z)
            g, J, low, high = self.linearise(candidate, target)
            residual = float(np.max(np.maximum(low - g, g - high), initial=0.0))
            if residual <= TOLERANCE:
                return KinematicsResult(candidate, residual)
            equality = low == high
            z = z + np.linalg.lstsq(J[equality], (low - g)[equality], rcond=None)[0]
            if np.any(z < self.limits[0]) or np.any(z > self.limits[1]):
                return None
        return None

    def _newton(
        self, values: Values, target: TargetContact, clearance_limits: FloatArray | None, limited: bool
    ) -> KinematicsResult:
        """Return the result of Newton steps with joint limits and critical clearances."""
        unlimited = np.full(len(self.limits[0]), NO_LIMIT)
        bounds = self.limits if limited else (-unlimited, unlimited)

        def linearised(z: FloatArray) -> Linearised:
            candidate = self._replace_variables(values, z)
            g, J, low, high = self.linearise(candidate, target)
            if clearance_limits is not None:
                c, slopes = self._critical_clearances(candidate, z, clearance_limits)
                g, J = np.concatenate([g, c]), np.concatenate([J, slopes])
                low, high = np.concatenate([low, np.zeros(len(c))]), np.concatenate([high, np.full(len(c), np.inf)])
            return Linearised(g, J, low, high, *step_bounds(z, bounds, MAX_STEP))

        result = restore_feasibility(linearised, np.clip(self._finger_variables(values), *bounds), NEWTON_RULES)
        return KinematicsResult(self._replace_variables(values, result.best), result.violation)

    def residual(self, values: Values, target: TargetContact) -> float:
        """Return the largest violation of the fingertip's constraints at a target contact, relative to their scales."""
        g, _, low, high = self.linearise(values, target)
        return float(np.max(np.maximum(low - g, g - high), initial=0.0))

    def linearise(self, values: Values, target: TargetContact) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the contact constraints (r,), their Jacobian in the finger's variables, lower and upper limits."""
        slides = values.get("slides", np.zeros(0))
        matrices = self._contact_function(
            values["palm_position"], values["palm_quaternion"], values["joints"], slides, target.point, target.normal
        )
        g, J, low, high = (np.asarray(m.full()) for m in matrices)
        return g.ravel(), J, low.ravel(), high.ravel()

    @cached_property
    def _contact_function(self) -> ca.Function:
        """CasADi function from posture and target contact to the contact constraints, their Jacobian and limits."""
        symbols = {name: ca.SX.sym(name, n) for name, n in (("palm_position", 3), ("palm_quaternion", 4))}
        symbols["joints"] = ca.SX.sym("q", len(self.hand.robot.free_joints))
        tips = [tip for _, tip in self.hand.tips]
        slides = ca.SX.sym("slides", sum(tip.slides for tip in tips))
        p, n = ca.SX.sym("p", 3), ca.SX.sym("n", 3)
        link, tip = self.hand.tips[self.finger]
        slide = None if self.slide is None else slides[self.slide]
        pose = self.hand.tree.poses(symbols)[link]
        constraints = tip.rows(SymbolicTouch(link, self.finger, pose, p, n, slide, self.size))
        variables = [symbols["joints"][int(i)] for i in self.joint_indices] + ([] if slide is None else [slide])
        g = ca.vertcat(*[constraint.expression / constraint.scale for constraint in constraints])
        low = ca.DM([constraint.lower / constraint.scale for constraint in constraints])
        high = ca.DM([constraint.upper / constraint.scale for constraint in constraints])
        outputs = [g, ca.densify(ca.jacobian(g, ca.vertcat(*variables))), low, high]
        return ca.Function("touch", [*symbols.values(), slides, p, n], outputs, {"cse": True})

    def _critical_clearances(
        self, values: Values, z: FloatArray, clearance_limits: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the slacks (c,) and gradients (c, m) of the critical clearances, divided by the body's size.

        A clearance is critical if it depends on the variables ``z`` (m,) and is near its limit.
        """
        c = self.model.clearances(values)
        perturbed = [self.model.clearances(self._replace_variables(values, z + DIFFERENCE * e)) for e in np.eye(len(z))]
        slopes = np.array([m - c for m in perturbed]).T / DIFFERENCE
        c = c - clearance_limits
        is_critical = np.any(slopes != 0.0, axis=1) & (c < CRITICAL_SHARE * self.hand.tree.span)
        return c[is_critical] / self.size, slopes[is_critical] / self.size

    def _finger_variables(self, values: Values) -> FloatArray:
        """Return the variables that move this finger alone."""
        joints = values["joints"][self.joint_indices]
        return joints if self.slide is None else np.append(joints, values["slides"][self.slide])

    def _replace_variables(self, values: Values, z: FloatArray) -> Values:
        """Return the hand's variables with those of this finger replaced."""
        joints = values["joints"].copy()
        joints[self.joint_indices] = z[: len(self.joint_indices)]
        result = {**values, "joints": joints}
        if self.slide is not None:
            result["slides"] = values["slides"].copy()
            result["slides"][self.slide] = z[-1]
        return result


def describe_obstruction(
    joints: FingerJoints, values: Values, target: TargetContact, clearance_limits: FloatArray
) -> str:
    """Return what prevents a finger from reaching its next waypoint, as text.

    Clearances are relaxed first, then joint limits; the relaxation that is needed is the reason. It is a local
    statement, for postures near the last one.

    Parameters
    ----------
    joints : FingerJoints
    values : dict
        The last reachable posture.
    target : TargetContact
        The next waypoint.
    clearance_limits : (n,) array
        Lower limits of the clearances.
    """
    return f"{_obstructing_part(joints, values, target, clearance_limits)}, {format_path_position(target)}"


def format_path_position(target: TargetContact) -> str:
    """Return the position of a finger on its path, as text."""
    position = f"{1e3 * target.along:.1f} mm along the path"
    if target.phase in (SLIDING, LIFTED):
        return position
    return f"{position}, {target.phase}, {1e3 * target.height:.1f} mm high"


def _obstructing_part(joints: FingerJoints, values: Values, target: TargetContact, clearance_limits: FloatArray) -> str:
    """Return what keeps the finger from its target, as text: a clearance, a joint limit, or the reach."""
    if not len(joints.joint_indices):
        return "no joint moves this finger alone"
    if joints.reach(values, target, clearance_limits).is_reached:
        return "the posture would have to jump"
    without_clearances = joints.reach(values, target, None)
    if without_clearances.is_reached:
        slack = joints.model.clearances(without_clearances.values) - clearance_limits
        return joints.model.describe_clearance(int(np.argmin(slack)))
    without_limits = joints.reach(values, target, None, limited=False)
    if without_limits.is_reached:
        return _limiting_joint(joints, values, without_limits.values)
    return "out of the finger's reach"


def _limiting_joint(joints: FingerJoints, values: Values, unlimited: Values) -> str:
    """Return the joint that stops at its limit, as text.

    Of the joints whose goals exceed their limits, it is the one nearest to its limit.
    """
    lower, upper = joints.hand.tree.joint_limits[:, joints.joint_indices]
    positions, goals = values["joints"][joints.joint_indices], unlimited["joints"][joints.joint_indices]
    excess = np.maximum(lower - goals, goals - upper)
    remaining = np.where(goals < lower, positions - lower, upper - positions)
    j = int(np.argmin(np.where(excess > 0.0, remaining, np.inf)))
    side = "lower" if goals[j] < lower[j] else "upper"
    return f"joint {joints.names[j]} at its {side} limit"
