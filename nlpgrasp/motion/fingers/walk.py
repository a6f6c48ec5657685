"""Adaptive stepping of a finger along its path, under clearances, joint limits and surface curvature.

From each waypoint a step is tried, and halved until four conditions hold. The finger's joints reach the waypoint within
joint limits and clearances. No joint turns by more than ``MOST_JOINT``, so that the posture does not jump between
branches of the inverse kinematics. At the middle of the joint motion, where a chord deviates most to second order, the
fingertip is off the path by less than the tolerance. No sphere can have penetrated anything by more than the tolerance
(``Surroundings.between``). Where a step of ``FINEST`` fails, the finger stops.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.motion.fingers.finger_joints import FingerJoints
from nlpgrasp.motion.fingers.stopped import why_stopped
from nlpgrasp.motion.paths.strides import OVER, Foothold, Stride

FINEST, LARGEST = 1.0 / 16.0, 16.0  # least and largest steps, in tolerances
MOST_JOINT = 0.1  # radians between waypoints; share of the span for sliding joints


@dataclass(frozen=True)
class Waypoint:
    """One posture on the path, with all clearances (n,)."""

    way: float
    hold: Foothold
    values: Values
    clearances: FloatArray


class Walk:
    """Motion of one finger along its path.

    Parameters
    ----------
    joints : FingerJoints
    stride : Stride
    """

    def __init__(self, joints: FingerJoints, stride: Stride) -> None:
        self.joints, self.stride, self.around = joints, stride, joints.around
        self._tip = self.around.of_tips()

    def allowed(self, way: float) -> FloatArray:
        """Return the lower limits of the clearances, (n,): a lifted fingertip stays off the body."""
        least = self.around.allowed()
        if self.stride.at(way).phase == OVER:
            least[self._tip] = 0.0
        return least - self.around.tolerance / 2.0

    def taken(self, values: Values) -> tuple[FingerPath, Values]:
        """Return the waypoints from a posture, and the final posture."""
        tolerance = self.around.tolerance
        first = self._waypoint(values, 0.0, self.allowed(0.0)) if len(self.joints.own) else None
        if first is None:
            return self._path([], why_stopped(self.joints, values, self.stride.at(0.0), self.allowed(0.0))), values
        done, step = [first], LARGEST * tolerance
        for end in self.stride.turns:
            while done[-1].way < end:
                way = min(done[-1].way + step, end)
                found = self._step(done[-1], way)
                if found is not None:
                    done.append(found)
                    step = min(2.0 * step, LARGEST * tolerance)
                elif way - done[-1].way <= FINEST * tolerance:
                    hold, allowed = self.stride.at(way), self.allowed((way + done[-1].way) / 2.0)
                    return self._path(done, why_stopped(self.joints, done[-1].values, hold, allowed)), done[-1].values
                else:
                    step = (way - done[-1].way) / 2.0
        return self._path(done, ""), done[-1].values

    def _waypoint(self, values: Values, way: float, allowed: FloatArray) -> Waypoint | None:
        hold = self.stride.at(way)
        found = self.joints.reach(values, hold, allowed)
        return Waypoint(way, hold, found.values, self.around.clearances(found.values)) if found.there else None

    def _step(self, here: Waypoint, way: float) -> Waypoint | None:
        """Return the waypoint after a step; None where the step is too long."""
        middle = (here.way + way) / 2.0
        allowed = self.allowed(middle)
        there = self._waypoint(here.values, way, allowed)
        if there is None:
            return None
        robot = self.joints.hand.robot
        scales = np.array([1.0 if j.turns else self.joints.hand.tree.span for j in robot.free_joints])
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
