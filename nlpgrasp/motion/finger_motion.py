"""Motion of a single finger along a contact path, for hands with and without links.

A hand with links (``LinkedMotions``): from each waypoint a step is tried, and halved until four conditions hold. The
finger's joints reach the waypoint within joint limits and clearances. No joint turns by more than ``MAX_JOINT_STEP``,
so that the posture does not jump between branches of the inverse kinematics. At the middle of the joint motion, where a
chord deviates most to second order, the fingertip is off the path by less than the tolerance. No link can have
penetrated anything by more than the tolerance (``HandClearance.clearance_bounds``). Where a step of ``LEAST_STEP``
fails, the finger stops.

A hand that is given by its contacts alone (``ContactMotions``), such as free fingertips or jaws, constrains these
jointly. Its constraints are evaluated at waypoints ``WAYPOINT_STEP`` apart: between two, no distance of two contacts or
from an obstacle differs by more than half of it from those at both ends. The palm point may move: any point that all
fingertips reach is allowed, and the set of these points is convex and changes continuously with the fingertips, so that
the palm can follow.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Hand, Values
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.contact_path import LIFTED, SLIDING, ContactPath, FingerTransfer, PathStation, TargetContact
from nlpgrasp.motion.distance_fields import build_distance_fields
from nlpgrasp.motion.finger_kinematics import FingerJoints, describe_obstruction, format_path_position
from nlpgrasp.problem.problem import GraspProblem

LEAST_STEP, LARGEST_STEP = 1.0 / 16.0, 16.0  # least and largest steps, in tolerances
MAX_JOINT_STEP = 0.1  # radians between waypoints; share of the span for sliding joints
SLIDE_CANDIDATES = np.linspace(0.0, 1.0, 201)  # candidate sliding coordinates, which a solution does not state
BALL_TOLERANCE = 1e-12  # relative tolerance of a point in a ball
WAYPOINT_STEP = 5e-3  # distance of waypoints of hands without links, over the body's size
CONSTRAINT_TOLERANCE = 1e-6  # feasibility tolerance, relative to the constraint's scale
PALM = "palm"  # name of the variable for the palm point
Contacts = tuple[FloatArray, FloatArray]  # points and inward unit normals


@dataclass(frozen=True)
class FingerPath:
    """Waypoints of a moving finger while palm and other fingers stay in place.

    Parameters
    ----------
    feasible : bool
        Whether the hand completes the path, with no link deeper than ``tolerance`` in anything between waypoints.
    reason : str
        Reason for an infeasible path, with the place; empty if feasible.
    points : (m, space) array
        Point of the fingertip that touches, or will touch, metres, body frame: waypoints up to the end, or up to the
        last reachable one.
    along : (m,) array
        Arc length on the surface up to each waypoint, metres.
    phases : tuple of m str
        ``"sliding"``, ``"lifting off"``, ``"lifted"`` or ``"setting down"``; ``"moving"`` for hands without links.
    clearances : (m,) array
        Least distance of the moving parts of the hand to anything that they must not touch, metres, at each waypoint;
        inf without any.
    joint_names : tuple of n str
        The finger's own joints; empty for hands without joints.
    joints : (m, n) array
        Their positions, radians or metres; between waypoints on straight lines.
    stopped_at : float or None
        Arc length at which the hand is stopped, metres.
    tolerance : float
        Allowed penetration of links between waypoints, metres.
    normals : (m, space) array or None
        Inward unit normal of the body at each waypoint, body frame; None where no waypoint was examined.
    """

    feasible: bool
    reason: str
    points: FloatArray
    along: FloatArray
    phases: tuple[str, ...]
    clearances: FloatArray
    joint_names: tuple[str, ...] = ()
    joints: FloatArray | None = None
    stopped_at: float | None = None
    tolerance: float = 0.0
    normals: FloatArray | None = None

    @property
    def clearance(self) -> float:
        """Least clearance over all waypoints, metres."""
        return float(np.min(self.clearances, initial=np.inf))

    def to_dict(self) -> Json:
        """Return the path as JSON data; an infinite clearance is None."""
        return {
            "feasible": self.feasible,
            "reason": self.reason,
            "points": self.points.tolist(),
            "normals": None if self.normals is None else self.normals.tolist(),
            "along": self.along.tolist(),
            "phases": list(self.phases),
            "clearances": [float(c) if np.isfinite(c) else None for c in self.clearances],
            "joint_names": list(self.joint_names),
            "joints": None if self.joints is None else self.joints.tolist(),
            "stopped_at": self.stopped_at,
            "tolerance": self.tolerance,
        }

    def __str__(self) -> str:
        if not self.feasible:
            return f"the hand does not get there: {self.reason}"
        least = f", least clearance at them {1e3 * self.clearance:.1f} mm" if np.isfinite(self.clearance) else ""
        return f"within the hand's limits ({len(self.points)} waypoints{least})"


class LinkedMotions:
    """Finger motions of a hand with links, within joint limits and clearances.

    Parameters
    ----------
    problem : GraspProblem
        Problem with the constraints to keep.
    hand : URDFHand
    values : dict
        Of the hand's variables in the first grasp.
    paths : sequence of k sequences of PathStation
        Path of each finger from its contact to its new one.
    lift : float
        Height of a lifted finger above the surface, metres.
    model : HandClearance, optional
        Of the same problem and hand, where it exists already.
    """

    def __init__(
        self,
        problem: GraspProblem,
        hand: URDFHand,
        values: Values,
        paths: Sequence[Sequence[PathStation]],
        lift: float,
        model: HandClearance | None = None,
    ) -> None:
        self.body, self.hand, self.paths, self.lift = problem.body, hand, paths, lift
        self.model = model or HandClearance(problem, hand)
        self.fingers = [FingerJoints(hand, i, self.model, problem.body.size) for i in range(hand.count)]
        self._first = self._with_slides(values)
        self._contact_paths: dict[tuple[int, float], ContactPath] = {}

    def start(self) -> Values:
        """Return the values of the hand's variables in the first grasp."""
        return self._first

    def move(self, posture: Values, finger: int, slides: bool) -> tuple[FingerPath, Values]:
        """Return the path of a finger from a posture to its new contact, and the final posture."""
        lift = 0.0 if slides else self.lift
        if (finger, lift) not in self._contact_paths:
            arm = self.hand.tips[finger][1].standoff + lift
            self._contact_paths[finger, lift] = ContactPath(self.body, self.paths[finger], arm, self.model.tolerance)
        transfer = FingerTransfer(self._contact_paths[finger, lift], lift)
        return FingerStepper(self.fingers[finger], transfer).move(posture)

    def _with_slides(self, values: Values) -> Values:
        """Return the values with sliding tip coordinates that bring the fingertips nearest to their contacts."""
        count = sum(tip.slides for _, tip in self.hand.tips)
        if not count:
            return values
        result = {**values, "slides": np.full(count, 0.5)}
        for joints, path in zip(self.fingers, self.paths, strict=True):
            if joints.slide is not None:
                target = TargetContact(path[0].point, path[0].normal, 0.0, SLIDING)
                residuals = []
                for slide in SLIDE_CANDIDATES:
                    result["slides"][joints.slide] = slide
                    residuals.append(joints.residual(result, target))
                result["slides"][joints.slide] = SLIDE_CANDIDATES[int(np.argmin(residuals))]
        return result


class FingerStepper:
    """Stepwise motion of one finger along its path, for a hand with links.

    Parameters
    ----------
    joints : FingerJoints
    transfer : FingerTransfer
    """

    def __init__(self, joints: FingerJoints, transfer: FingerTransfer) -> None:
        self.joints, self.transfer, self.model = joints, transfer, joints.model
        self._tip = self.model.tip_mask()

    def clearance_limits(self, path_length: float) -> FloatArray:
        """Return the lower limits of the clearances, (n,), metres; a lifted fingertip also has one from the body."""
        limits = self.model.least_clearances()
        if self.transfer.at(path_length).phase == LIFTED:
            limits[self._tip] = 0.0
        return limits - self.model.tolerance / 2.0

    def move(self, values: Values) -> tuple[FingerPath, Values]:
        """Return the waypoints from a given posture on, and the final posture."""
        tolerance, limits = self.model.tolerance, self.clearance_limits(0.0)
        first = self._waypoint(values, 0.0, limits) if len(self.joints.joint_indices) else None
        if first is None:
            reason = describe_obstruction(self.joints, values, self.transfer.at(0.0), limits)
            return self._record([], reason), values
        waypoints, step = [first], LARGEST_STEP * tolerance
        for end in self.transfer.phase_changes:
            while waypoints[-1].path_length < end:
                path_length = min(waypoints[-1].path_length + step, end)
                waypoint = self._step(waypoints[-1], path_length)
                if waypoint is not None:
                    waypoints.append(waypoint)
                    step = min(2.0 * step, LARGEST_STEP * tolerance)
                elif path_length - waypoints[-1].path_length <= LEAST_STEP * tolerance:
                    last, target = waypoints[-1], self.transfer.at(path_length)
                    limits = self.clearance_limits((path_length + last.path_length) / 2.0)
                    reason = describe_obstruction(self.joints, last.values, target, limits)
                    return self._record(waypoints, reason), last.values
                else:
                    step = (path_length - waypoints[-1].path_length) / 2.0
        return self._record(waypoints, ""), waypoints[-1].values

    def _waypoint(self, values: Values, path_length: float, limits: FloatArray) -> Waypoint | None:
        """Return the waypoint at a path length; None if the finger does not reach it."""
        target = self.transfer.at(path_length)
        result = self.joints.reach(values, target, limits)
        if not result.is_reached:
            return None
        return Waypoint(path_length, target, result.values, self.model.clearances(result.values))

    def _step(self, start: Waypoint, path_length: float) -> Waypoint | None:
        """Return the waypoint after one step; None if the step is too long."""
        middle = (start.path_length + path_length) / 2.0
        limits = self.clearance_limits(middle)
        end = self._waypoint(start.values, path_length, limits)
        if end is None:
            return None
        robot = self.joints.hand.robot
        scales = np.array([1.0 if j.is_revolute else self.joints.hand.tree.span for j in robot.free_joints])
        if np.max(np.abs(end.values["joints"] - start.values["joints"]) / scales) > MAX_JOINT_STEP:
            return None
        middle_values = {name: (start.values[name] + end.values[name]) / 2.0 for name in start.values}
        if self.joints.residual(middle_values, self.transfer.at(middle)) * self.joints.size > self.model.tolerance:
            return None
        bounds = self.model.clearance_bounds(start.values, end.values, (start.clearances, end.clearances))
        return end if np.all(bounds >= limits - self.model.tolerance / 2.0) else None

    def _least_clearance(self, waypoint: Waypoint) -> float:
        """Return the least clearance at a waypoint, metres, without that of fingertips from the body."""
        return float(np.min(waypoint.clearances[~self._tip], initial=np.inf))

    def _record(self, waypoints: list[Waypoint], reason: str) -> FingerPath:
        """Return the finger's path through the waypoints, infeasible if a reason is given."""
        path_length = waypoints[-1].path_length if waypoints else 0.0
        targets = [w.target for w in waypoints]
        return FingerPath(
            feasible=not reason,
            reason=reason,
            points=np.array([h.point for h in targets]).reshape(-1, 3),
            along=np.array([h.along for h in targets]),
            phases=tuple(h.phase for h in targets),
            clearances=np.array([self._least_clearance(w) for w in waypoints]),
            joint_names=self.joints.names,
            joints=np.array([w.values["joints"][self.joints.joint_indices] for w in waypoints]).reshape(
                len(waypoints), len(self.joints.joint_indices)
            ),
            stopped_at=self.transfer.at(path_length).along if reason else None,
            tolerance=self.model.tolerance,
            normals=np.array([h.normal for h in targets]).reshape(-1, 3),
        )


@dataclass(frozen=True)
class Waypoint:
    """Posture of the hand at a path length, with its target contact and all clearances (n,)."""

    path_length: float
    target: TargetContact
    values: Values
    clearances: FloatArray


class ContactMotions:
    """Finger motions of a hand without links, given by its contacts alone.

    Arguments as for ``LinkedMotions``.
    """

    def __init__(
        self, problem: GraspProblem, hand: Hand, contacts: Contacts, paths: Sequence[Sequence[PathStation]], lift: float
    ) -> None:
        self.body, self.hand, self.paths, self.lift, self._first = problem.body, hand, paths, lift, contacts
        self.fields = build_distance_fields(problem.body, problem.constraints, hand.count)[1:]
        size, space, k = problem.body.size, problem.body.space, hand.count
        p, n = ([ca.SX.sym(f"{name}{i}", space) for i in range(k)] for name in "pn")
        variables = hand.symbols(problem.body.bounds)
        self.rows = list(hand.rows(SymbolicCandidate(p, n, hand.tip_radii, size), variables))
        inputs = [ca.horzcat(*p), ca.horzcat(*n), ca.vertcat(ca.SX(0, 1), *variables.values())]
        expressions = [constraint.expression for constraint in self.rows]
        self._values = ca.Function("rows", inputs, [ca.vertcat(ca.SX(0, 1), *expressions)])
        self.variables = tuple(variables)

    def start(self) -> Contacts:
        """Return contact points and normals of the first grasp."""
        return self._first

    def move(self, posture: Contacts, finger: int, slides: bool) -> tuple[FingerPath, Contacts]:
        """Return the path of a finger to its new contact, and all contacts at the end."""
        lift, step = 0.0 if slides else self.lift, WAYPOINT_STEP * self.body.size
        radius = self.hand.tip_radii[finger]
        transfer = FingerTransfer(ContactPath(self.body, self.paths[finger], radius + lift, step), lift)
        edges = np.unique([0.0, *transfer.phase_changes])
        counts = [max(int(np.ceil((b - a) / step)), 1) for a, b in itertools.pairwise(edges)]
        path_lengths = [np.linspace(a, b, c + 1)[1:] for a, b, c in zip(edges[:-1], edges[1:], counts, strict=True)]
        targets, clearances, reason = list[TargetContact](), list[float](), ""
        for path_length in np.concatenate([[0.0], *path_lengths]):
            target = transfer.at(float(path_length))
            clearance, reason = self._violation(posture, finger, target)
            if reason:
                reason = f"{reason}, {format_path_position(target)}"
                break
            targets.append(target)
            clearances.append(clearance)
        points = np.array([h.point for h in targets]).reshape(len(targets), -1)
        along, phases = np.array([h.along for h in targets]), tuple(h.phase for h in targets)
        stopped = (targets[-1].along if targets else 0.0) if reason else None
        path = FingerPath(
            not reason,
            reason,
            points,
            along,
            phases,
            np.array(clearances),
            stopped_at=stopped,
            tolerance=step / 2.0,
            normals=np.array([h.normal for h in targets]).reshape(points.shape),
        )
        return path, posture if reason else self._with_finger_at(posture, finger, target)

    def _with_finger_at(self, posture: Contacts, finger: int, target: TargetContact) -> Contacts:
        """Return the contacts, with one finger's contact at its target."""
        points, normals = (part.copy() for part in posture)
        points[finger], normals[finger] = target.point, target.normal
        return points, normals

    def _violation(self, posture: Contacts, finger: int, target: TargetContact) -> tuple[float, str]:
        """Return the fingertip's clearance at a target, metres, and the violated constraint as text."""
        points, normals = self._with_finger_at(posture, finger, target)
        radii = np.asarray(self.hand.tip_radii)
        tips = points - radii[:, None] * normals
        clearances = [float(field.distance(tips[finger][None])[0] - radii[finger]) for field in self.fields]
        for field, clearance in zip(self.fields, clearances, strict=True):
            if clearance < -CONSTRAINT_TOLERANCE * self.body.size:
                return clearance, f"fingertip {finger} against {field.name}"
        values = np.asarray(self._values(points.T, normals.T, self._hand_values(tips)).full()).ravel()
        for constraint, value in zip(self.rows, values, strict=True):
            if max(constraint.lower - value, value - constraint.upper) > CONSTRAINT_TOLERANCE * constraint.scale:
                return min(clearances, default=np.inf), _violation_text(constraint, float(value))
        return min(clearances, default=np.inf), ""

    def _hand_values(self, tips: FloatArray) -> FloatArray:
        """Return the hand's variables, given fingertip centres (k, space), metres.

        A palm point is the centre of the smallest ball around these.
        """
        if self.variables == (PALM,):
            return smallest_ball(tips)[0]
        start = self.hand.start(tips)
        return np.concatenate([np.zeros(0), *[start[name] for name in self.variables]])


def _violation_text(constraint: ScalarConstraint, value: float) -> str:
    """Return the violation of a constraint, as text."""
    is_low = value < constraint.lower
    limit, side = (constraint.lower, "at least") if is_low else (constraint.upper, "at most")
    if constraint.unit == "m2":
        return f"{constraint.name} would be {1e3 * np.sqrt(value):.1f} mm, {side} {1e3 * np.sqrt(limit):.1f} mm"
    return f"{constraint.name} would be {value:.4g}, {side} {limit:.4g}"


def smallest_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius of the smallest ball that contains points (k, space), metres.

    It is found by Welzl's algorithm.
    """
    return _ball_around(list(points), [], points.shape[1])


def _ball_around(points: Sequence[FloatArray], boundary: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball that contains ``points`` and has the points of ``boundary`` on its surface."""
    if not points or len(boundary) == space + 1:
        return _ball_through(boundary, space)
    first, rest = points[0], points[1:]
    centre, radius = _ball_around(rest, boundary, space)
    if np.linalg.norm(first - centre) <= radius * (1.0 + BALL_TOLERANCE):
        return centre, radius
    return _ball_around(rest, [*boundary, first], space)


def _ball_through(boundary: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball with all points on its surface; radius -1 without points."""
    if not boundary:
        return np.zeros(space), -1.0
    sides = np.array(boundary[1:]).reshape(-1, space) - boundary[0]
    weights = np.linalg.lstsq(sides @ sides.T, np.sum(sides**2, axis=1) / 2.0, rcond=None)[0]
    offset = sides.T @ weights
    return boundary[0] + offset, float(np.linalg.norm(offset))
