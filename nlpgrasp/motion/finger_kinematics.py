"""Inverse kinematics of one finger, with fixed palm and other fingers, and the obstruction that stops it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.common.quadratic_program import Linearised, NewtonRules, restore_feasibility, step_bounds
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.tips import SymbolicTouch
from nlpgrasp.motion.contact_path import OVER, SLIDING, TargetContact
from nlpgrasp.motion.link_clearance import CollisionModel

ENOUGH = 1e-6  # share of the body's size, and radians: tolerance of a reached contact
STEPS = NewtonRules(steps=15, enough=ENOUGH)  # with joint limits and clearances
FREE_STEPS = 6  # before these, on the contact's equations alone, at most
LONGEST = 0.2  # radians (metres for sliding joints, tip coordinates): largest Newton step
NEAR = 0.1  # share of the hand's span: clearances below this enter the steps
DIFFERENCE = 1e-6  # radians or metres: step of finite differences
FREE = 1e3  # joint limits that never bind


@dataclass(frozen=True)
class KinematicsResult:
    """Joint positions found by Newton's method.

    Parameters
    ----------
    values : dict
        Of the hand's variables.
    off : float
        Residual of the fingertip at its contact, shares of the body's size and radians.
    """

    values: Values
    off: float

    @property
    def is_reached(self) -> bool:
        """Whether the fingertip is at its contact, within tolerance."""
        return self.off <= ENOUGH


class FingerJoints:
    """Inverse kinematics of one finger by Newton's method with joint limits and clearances.

    Each Newton step is the shortest that keeps joint limits, places the fingertip to first order, and keeps the
    critical clearances: redundant joints avoid collisions. A joint that also moves another finger's contact stays
    fixed.

    Parameters
    ----------
    hand : URDFHand
    finger : int
    surroundings : CollisionModel
    size : float
        The body's, metres.

    Attributes
    ----------
    own : (m,) int array
        Indices of its free joints.
    """

    def __init__(self, hand: URDFHand, finger: int, surroundings: CollisionModel, size: float) -> None:
        self.hand, self.finger, self.size = hand, finger, size
        robot = hand.robot
        moved = [{robot.driving_joint(j)[0] for j in robot.chain(link) if j.moves} for link, _ in hand.tips]
        others = set().union(*(names for i, names in enumerate(moved) if i != finger))
        names = moved[finger] - others
        self.own = np.array([i for i, j in enumerate(robot.free_joints) if j.name in names], int)
        self.around = surroundings.of_joints(self.own)
        limits = hand.tree.joint_limits[:, self.own]
        tip = hand.tips[finger][1]
        self.slide = sum(t.slides for _, t in hand.tips[:finger]) if tip.slides else None
        extra = [] if self.slide is None else [1.0]
        self.limits = np.concatenate([limits[0], [0.0] * len(extra)]), np.concatenate([limits[1], extra])

    @property
    def names(self) -> tuple[str, ...]:
        """The finger's own joints."""
        return tuple(self.hand.robot.free_joints[i].name for i in self.own)

    def reach(
        self, values: Values, hold: TargetContact, allowed: FloatArray | None, *, limited: bool = True
    ) -> KinematicsResult:
        """Return the nearest positions of the finger's joints with its fingertip at a foothold.

        Clearances enter the Newton steps only if they are violated without.

        Parameters
        ----------
        values : dict
            Initial values of the hand's variables.
        hold : TargetContact
        allowed : (n,) array or None
            Lower limits of the clearances, metres; None to ignore them.
        limited : bool
            Whether to keep joint limits.
        """
        found = self._shortest(values, hold) or self._newton(values, hold, None, limited)
        if allowed is None or (found.is_reached and np.all(self.around.clearances(found.values) >= allowed)):
            return found
        return self._newton(values, hold, allowed, limited)

    def _shortest(self, values: Values, hold: TargetContact) -> KinematicsResult | None:
        """Return the result of shortest steps on the equations alone; None where a limit is violated."""
        z = self._of(values)
        for _ in range(FREE_STEPS):
            here = self._with(values, z)
            g, J, low, high = self.rows(here, hold)
            off = float(np.max(np.maximum(low - g, g - high), initial=0.0))
            if off <= ENOUGH:
                return KinematicsResult(here, off)
            equal = low == high
            z = z + np.linalg.lstsq(J[equal], (low - g)[equal], rcond=None)[0]
            if np.any(z < self.limits[0]) or np.any(z > self.limits[1]):
                return None
        return None

    def _newton(
        self, values: Values, hold: TargetContact, allowed: FloatArray | None, limited: bool
    ) -> KinematicsResult:
        unlimited = np.full(len(self.limits[0]), FREE)
        bounds = self.limits if limited else (-unlimited, unlimited)

        def rows(z: FloatArray) -> Linearised:
            here = self._with(values, z)
            g, J, low, high = self.rows(here, hold)
            if allowed is not None:
                c, slopes = self._dangers(here, z, allowed)
                g, J = np.concatenate([g, c]), np.concatenate([J, slopes])
                low, high = np.concatenate([low, np.zeros(len(c))]), np.concatenate([high, np.full(len(c), np.inf)])
            return Linearised(g, J, low, high, *step_bounds(z, bounds, LONGEST))

        found = restore_feasibility(rows, np.clip(self._of(values), *bounds), STEPS)
        return KinematicsResult(self._with(values, found.best), found.violation)

    def off(self, values: Values, hold: TargetContact) -> float:
        """Return the residual of the fingertip at a foothold, shares of the body's size and radians."""
        g, _, low, high = self.rows(values, hold)
        return float(np.max(np.maximum(low - g, g - high), initial=0.0))

    def rows(self, values: Values, hold: TargetContact) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return contact constraints at a foothold, (r,), their slopes in the finger's variables, and their limits."""
        slides = values.get("slides", np.zeros(0))
        found = self._rows(
            values["palm_position"], values["palm_quaternion"], values["joints"], slides, hold.point, hold.normal
        )
        g, J, low, high = (np.asarray(m.full()) for m in found)
        return g.ravel(), J, low.ravel(), high.ravel()

    @cached_property
    def _rows(self) -> ca.Function:
        symbols = {name: ca.SX.sym(name, n) for name, n in (("palm_position", 3), ("palm_quaternion", 4))}
        symbols["joints"] = ca.SX.sym("q", len(self.hand.robot.free_joints))
        tips = [tip for _, tip in self.hand.tips]
        slides = ca.SX.sym("slides", sum(tip.slides for tip in tips))
        p, n = ca.SX.sym("p", 3), ca.SX.sym("n", 3)
        link, tip = self.hand.tips[self.finger]
        slide = None if self.slide is None else slides[self.slide]
        rows = tip.rows(SymbolicTouch(link, self.finger, self.hand.tree.poses(symbols)[link], p, n, slide, self.size))
        own = [symbols["joints"][int(i)] for i in self.own] + ([] if slide is None else [slide])
        g = ca.vertcat(*[row.expression / row.scale for row in rows])
        low, high = ca.DM([row.lower / row.scale for row in rows]), ca.DM([row.upper / row.scale for row in rows])
        outputs = [g, ca.densify(ca.jacobian(g, ca.vertcat(*own))), low, high]
        return ca.Function("touch", [*symbols.values(), slides, p, n], outputs, {"cse": True})

    def _dangers(self, here: Values, z: FloatArray, allowed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the slack of critical clearances, shares of the body's size, and their gradients."""
        c = self.around.clearances(here)
        moved = [self.around.clearances(self._with(here, z + DIFFERENCE * e)) for e in np.eye(len(z))]
        slopes = np.array([m - c for m in moved]).T / DIFFERENCE
        c = c - allowed
        near = np.any(slopes != 0.0, axis=1) & (c < NEAR * self.hand.tree.span)
        return c[near] / self.size, slopes[near] / self.size

    def _of(self, values: Values) -> FloatArray:
        """Return the finger's own variables."""
        own = values["joints"][self.own]
        return own if self.slide is None else np.append(own, values["slides"][self.slide])

    def _with(self, values: Values, z: FloatArray) -> Values:
        """Return the hand's variables with the finger's own replaced."""
        joints = values["joints"].copy()
        joints[self.own] = z[: len(self.own)]
        result = {**values, "joints": joints}
        if self.slide is not None:
            result["slides"] = values["slides"].copy()
            result["slides"][self.slide] = z[-1]
        return result


def obstruction_text(joints: FingerJoints, values: Values, hold: TargetContact, allowed: FloatArray) -> str:
    """Return the obstruction of a finger's next waypoint, as text.

    Clearances are relaxed first, then joint limits; the relaxation that is needed is the reason. It is a local
    statement, for postures near the last one.

    Parameters
    ----------
    joints : FingerJoints
    values : dict
        The last reachable posture.
    hold : TargetContact
        The next waypoint.
    allowed : (n,) array
        Lower limits of the clearances.
    """
    return f"{_obstructing_part(joints, values, hold, allowed)}, {place(hold)}"


def place(hold: TargetContact) -> str:
    """Return a finger's place on its path, as text."""
    where = f"{1e3 * hold.along:.1f} mm along the path"
    return where if hold.phase in (SLIDING, OVER) else f"{where}, {hold.phase}, {1e3 * hold.height:.1f} mm high"


def _obstructing_part(joints: FingerJoints, values: Values, hold: TargetContact, allowed: FloatArray) -> str:
    if not len(joints.own):
        return "no joint moves this finger alone"
    if joints.reach(values, hold, allowed).is_reached:
        return "the posture would have to jump"
    within = joints.reach(values, hold, None)
    if within.is_reached:
        return joints.around.describe_clearance(int(np.argmin(joints.around.clearances(within.values) - allowed)))
    beyond = joints.reach(values, hold, None, limited=False)
    if beyond.is_reached:
        return _limiting_joint(joints, values, beyond.values)
    return "out of the finger's reach"


def _limiting_joint(joints: FingerJoints, values: Values, beyond: Values) -> str:
    """Return the joint at its limit: of those that would exceed it, the nearest to it now."""
    lower, upper = joints.hand.tree.joint_limits[:, joints.own]
    now, then = values["joints"][joints.own], beyond["joints"][joints.own]
    over = np.maximum(lower - then, then - upper)
    left = np.where(then < lower, now - lower, upper - now)
    j = int(np.argmin(np.where(over > 0.0, left, np.inf)))
    side = "lower" if then[j] < lower[j] else "upper"
    return f"joint {joints.names[j]} at its {side} limit"
