"""Motion of a single finger along its contact path: of a hand with links, of free fingertips and jaws.

A hand with links (``LinkedMotions``): from each waypoint a step is tried, and halved until four conditions hold. The
finger's joints reach the waypoint within joint limits and clearances. No joint turns by more than ``MOST_JOINT``, so
that the posture does not jump between branches of the inverse kinematics. At the middle of the joint motion, where a
chord deviates most to second order, the fingertip is off the path by less than the tolerance. No sphere can have
penetrated anything by more than the tolerance (``CollisionModel.between``). Where a step of ``FINEST`` fails, the
finger stops.

A hand that is given by its contacts alone (``ContactMotions``), such as free fingertips or jaws, constrains these
jointly. Its constraints are evaluated at waypoints ``STEP`` apart: between two, no distance of two contacts or from an
obstacle differs by more than half of it from those at both ends. The palm point may move: any point that all fingertips
reach is allowed, and the set of these points is convex and changes continuously with the fingertips, so that the palm
can follow.
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
from nlpgrasp.motion.contact_path import OVER, SLIDING, ContactPath, FingerTransfer, PathStation, TargetContact
from nlpgrasp.motion.distance_fields import fields_of
from nlpgrasp.motion.finger_kinematics import FingerJoints, obstruction_text, place
from nlpgrasp.motion.link_clearance import CollisionModel
from nlpgrasp.problem.problem import GraspProblem

FINEST, LARGEST = 1.0 / 16.0, 16.0  # least and largest steps, in tolerances
MOST_JOINT = 0.1  # radians between waypoints; share of the span for sliding joints
SLIDES = np.linspace(0.0, 1.0, 201)  # candidate sliding coordinates, which a solution does not state
INSIDE = 1e-12  # relative tolerance of a point in a ball
STEP = 5e-3  # distance of waypoints of hands without links, over the body's size
ENOUGH = 1e-6  # feasibility tolerance, relative to the constraint's scale
PALM = "palm"  # name of the variable for the palm point
Contacts = tuple[FloatArray, FloatArray]  # points and inward unit normals


@dataclass(frozen=True)
class FingerPath:
    """Waypoints of a moving finger while the palm and the other fingers stay.

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

    @property
    def clearance(self) -> float:
        """Least clearance of all waypoints, metres."""
        return float(np.min(self.clearances, initial=np.inf))

    def to_dict(self) -> Json:
        """Return the path as JSON data; an infinite clearance is None."""
        return {
            "feasible": self.feasible,
            "reason": self.reason,
            "points": self.points.tolist(),
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
    """Finger motions of a URDF hand.

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
    """

    def __init__(
        self, problem: GraspProblem, hand: URDFHand, values: Values, paths: Sequence[Sequence[PathStation]], lift: float
    ) -> None:
        self.body, self.hand, self.paths, self.lift = problem.body, hand, paths, lift
        self.around = CollisionModel(problem, hand)
        self.fingers = [FingerJoints(hand, i, self.around, problem.body.size) for i in range(hand.count)]
        self._first = self._with_slides(values)
        self._footpaths: dict[tuple[int, float], ContactPath] = {}

    def start(self) -> Values:
        """Return the values of the hand's variables in the first grasp."""
        return self._first

    def move(self, posture: Values, finger: int, slides: bool) -> tuple[FingerPath, Values]:
        """Return the path of a finger from a posture to its new contact, and the final posture."""
        lift = 0.0 if slides else self.lift
        if (finger, lift) not in self._footpaths:
            arm = self.hand.tips[finger][1].standoff + lift
            self._footpaths[finger, lift] = ContactPath(self.body, self.paths[finger], arm, self.around.tolerance)
        return FingerStepping(self.fingers[finger], FingerTransfer(self._footpaths[finger, lift], lift)).move(posture)

    def _with_slides(self, values: Values) -> Values:
        """Return the values with the sliding coordinates of tips nearest to their contacts."""
        count = sum(tip.slides for _, tip in self.hand.tips)
        if not count:
            return values
        result = {**values, "slides": np.full(count, 0.5)}
        for joints, path in zip(self.fingers, self.paths, strict=True):
            if joints.slide is not None:
                hold = TargetContact(path[0].point, path[0].normal, 0.0, SLIDING)
                off = []
                for share in SLIDES:
                    result["slides"][joints.slide] = share
                    off.append(joints.off(result, hold))
                result["slides"][joints.slide] = SLIDES[int(np.argmin(off))]
        return result


class FingerStepping:
    """Motion of one finger along its path.

    Parameters
    ----------
    joints : FingerJoints
    stride : FingerTransfer
    """

    def __init__(self, joints: FingerJoints, stride: FingerTransfer) -> None:
        self.joints, self.stride, self.around = joints, stride, joints.around
        self._tip = self.around.of_tips()

    def allowed(self, way: float) -> FloatArray:
        """Return the lower limits of the clearances, (n,): a lifted fingertip stays off the body."""
        least = self.around.least_clearances()
        if self.stride.at(way).phase == OVER:
            least[self._tip] = 0.0
        return least - self.around.tolerance / 2.0

    def move(self, values: Values) -> tuple[FingerPath, Values]:
        """Return the waypoints from a posture, and the final posture."""
        tolerance = self.around.tolerance
        first = self._waypoint(values, 0.0, self.allowed(0.0)) if len(self.joints.own) else None
        if first is None:
            return self._path([], obstruction_text(self.joints, values, self.stride.at(0.0), self.allowed(0.0))), values
        done, step = [first], LARGEST * tolerance
        for end in self.stride.phase_changes:
            while done[-1].way < end:
                way = min(done[-1].way + step, end)
                found = self._step(done[-1], way)
                if found is not None:
                    done.append(found)
                    step = min(2.0 * step, LARGEST * tolerance)
                elif way - done[-1].way <= FINEST * tolerance:
                    hold, allowed = self.stride.at(way), self.allowed((way + done[-1].way) / 2.0)
                    return self._path(done, obstruction_text(self.joints, done[-1].values, hold, allowed)), done[
                        -1
                    ].values
                else:
                    step = (way - done[-1].way) / 2.0
        return self._path(done, ""), done[-1].values

    def _waypoint(self, values: Values, way: float, allowed: FloatArray) -> Waypoint | None:
        hold = self.stride.at(way)
        found = self.joints.reach(values, hold, allowed)
        return Waypoint(way, hold, found.values, self.around.clearances(found.values)) if found.is_reached else None

    def _step(self, here: Waypoint, way: float) -> Waypoint | None:
        """Return the waypoint after a step; None where the step is too long."""
        middle = (here.way + way) / 2.0
        allowed = self.allowed(middle)
        there = self._waypoint(here.values, way, allowed)
        if there is None:
            return None
        robot = self.joints.hand.robot
        scales = np.array([1.0 if j.is_revolute else self.joints.hand.tree.span for j in robot.free_joints])
        if np.max(np.abs(there.values["joints"] - here.values["joints"]) / scales) > MOST_JOINT:
            return None
        between = {name: (here.values[name] + there.values[name]) / 2.0 for name in here.values}
        if self.joints.off(between, self.stride.at(middle)) * self.joints.size > self.around.tolerance:
            return None
        least = self.around.between(here.values, there.values, (here.clearances, there.clearances))
        return there if np.all(least >= allowed - self.around.tolerance / 2.0) else None

    def _path(self, done: list[Waypoint], reason: str) -> FingerPath:
        """Return the record of the waypoints."""
        last = done[-1].way if done else 0.0
        holds = [w.hold for w in done]
        return FingerPath(
            feasible=not reason,
            reason=reason,
            points=np.array([h.point for h in holds]).reshape(-1, 3),
            along=np.array([h.along for h in holds]),
            phases=tuple(h.phase for h in holds),
            clearances=np.array([np.min(w.clearances[~self._tip], initial=np.inf) for w in done]),
            joint_names=self.joints.names,
            joints=np.array([w.values["joints"][self.joints.own] for w in done]).reshape(
                len(done), len(self.joints.own)
            ),
            stopped_at=self.stride.at(last).along if reason else None,
            tolerance=self.around.tolerance,
        )


@dataclass(frozen=True)
class Waypoint:
    """One posture on the path, with all clearances (n,)."""

    way: float
    hold: TargetContact
    values: Values
    clearances: FloatArray


class ContactMotions:
    """Finger motions of hands that are given by their contacts alone; arguments as for ``LinkedMotions``."""

    def __init__(
        self, problem: GraspProblem, hand: Hand, contacts: Contacts, paths: Sequence[Sequence[PathStation]], lift: float
    ) -> None:
        self.body, self.hand, self.paths, self.lift, self._first = problem.body, hand, paths, lift, contacts
        self.fields = fields_of(problem.body, problem.constraints, hand.count)[1:]
        size, space, k = problem.body.size, problem.body.space, hand.count
        p, n = ([ca.SX.sym(f"{name}{i}", space) for i in range(k)] for name in "pn")
        variables = hand.symbols(problem.body.bounds)
        self.rows = list(hand.rows(SymbolicCandidate(p, n, hand.tip_radii, size), variables))
        inputs = [ca.horzcat(*p), ca.horzcat(*n), ca.vertcat(ca.SX(0, 1), *variables.values())]
        self._values = ca.Function("rows", inputs, [ca.vertcat(ca.SX(0, 1), *[row.expression for row in self.rows])])
        self.variables = tuple(variables)

    def start(self) -> Contacts:
        """Return points and normals of the first grasp."""
        return self._first

    def move(self, posture: Contacts, finger: int, slides: bool) -> tuple[FingerPath, Contacts]:
        """Return the path of a finger to its new contact, and all contacts at its end."""
        lift, step = 0.0 if slides else self.lift, STEP * self.body.size
        radius = self.hand.tip_radii[finger]
        stride = FingerTransfer(ContactPath(self.body, self.paths[finger], radius + lift, step), lift)
        edges = np.unique([0.0, *stride.phase_changes])
        counts = [max(int(np.ceil((b - a) / step)), 1) for a, b in itertools.pairwise(edges)]
        ways = [np.linspace(a, b, c + 1)[1:] for a, b, c in zip(edges[:-1], edges[1:], counts, strict=True)]
        holds, clearances, reason = list[TargetContact](), list[float](), ""
        for way in np.concatenate([[0.0], *ways]):
            hold = stride.at(float(way))
            clear, reason = self._broken(posture, finger, hold)
            if reason:
                reason = f"{reason}, {place(hold)}"
                break
            holds.append(hold)
            clearances.append(clear)
        points = np.array([h.point for h in holds]).reshape(len(holds), -1)
        along, phases = np.array([h.along for h in holds]), tuple(h.phase for h in holds)
        stopped = (holds[-1].along if holds else 0.0) if reason else None
        path = FingerPath(
            not reason, reason, points, along, phases, np.array(clearances), stopped_at=stopped, tolerance=step / 2.0
        )
        return path, posture if reason else self._with(posture, finger, hold)

    def _with(self, posture: Contacts, finger: int, hold: TargetContact) -> Contacts:
        """Return the contacts with one finger at a foothold."""
        points, normals = (part.copy() for part in posture)
        points[finger], normals[finger] = hold.point, hold.normal
        return points, normals

    def _broken(self, posture: Contacts, finger: int, hold: TargetContact) -> tuple[float, str]:
        """Return the fingertip's clearance, and the violated constraint at a foothold, as text."""
        points, normals = self._with(posture, finger, hold)
        radii = np.asarray(self.hand.tip_radii)
        tips = points - radii[:, None] * normals
        clearances = [float(field.distance(tips[finger][None])[0] - radii[finger]) for field in self.fields]
        for field, clear in zip(self.fields, clearances, strict=True):
            if clear < -ENOUGH * self.body.size:
                return clear, f"fingertip {finger} against {field.name}"
        values = np.asarray(self._values(points.T, normals.T, self._hand_values(tips)).full()).ravel()
        for row, value in zip(self.rows, values, strict=True):
            if max(row.lower - value, value - row.upper) > ENOUGH * row.scale:
                return min(clearances, default=np.inf), _violation_text(row, float(value))
        return min(clearances, default=np.inf), ""

    def _hand_values(self, tips: FloatArray) -> FloatArray:
        """Return the hand's own variables for fingertip centres (k, space): the centre of their smallest ball."""
        if self.variables == (PALM,):
            return smallest_ball(tips)[0]
        start = self.hand.start(tips)
        return np.concatenate([np.zeros(0), *[start[name] for name in self.variables]])


def _violation_text(row: ScalarConstraint, value: float) -> str:
    """Return the violation of a constraint, as text."""
    low = value < row.lower
    limit, side = (row.lower, "at least") if low else (row.upper, "at most")
    if row.unit == "m2":
        return f"{row.name} would be {1e3 * np.sqrt(value):.1f} mm, {side} {1e3 * np.sqrt(limit):.1f} mm"
    return f"{row.name} would be {value:.4g}, {side} {limit:.4g}"


def smallest_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius of the smallest ball around points (k, space), metres, by Welzl's algorithm."""
    return _around(list(points), [], points.shape[1])


def _around(points: Sequence[FloatArray], on: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball around ``points`` with the points of ``on`` on its surface."""
    if not points or len(on) == space + 1:
        return _ball_through(on, space)
    first, rest = points[0], points[1:]
    centre, radius = _around(rest, on, space)
    if np.linalg.norm(first - centre) <= radius * (1.0 + INSIDE):
        return centre, radius
    return _around(rest, [*on, first], space)


def _ball_through(on: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball through points; one of radius -1 for none."""
    if not on:
        return np.zeros(space), -1.0
    sides = np.array(on[1:]).reshape(-1, space) - on[0]
    shares = np.linalg.lstsq(sides @ sides.T, np.sum(sides**2, axis=1) / 2.0, rcond=None)[0]
    out = sides.T @ shares
    return on[0] + out, float(np.linalg.norm(out))
