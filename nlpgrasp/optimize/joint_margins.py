"""Margins of a hand's joints from their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.solution.analysis_records import SMALL, JointMargins

SHARE = 0.1  # share of a joint's range: upper bound on its margin


@dataclass(frozen=True)
class JointLimitMargins:
    """Free joints of a hand with their limits and required margins.

    Parameters
    ----------
    names : tuple of m str
    limits : (2, m) array
        Lower and upper limits, radians; metres for prismatic joints.
    wanted : (m,) array
        Required margins: at most a tenth of a joint's range, exactly that for prismatic joints.
    """

    names: tuple[str, ...]
    limits: FloatArray
    wanted: FloatArray

    @classmethod
    def of(cls, hand: URDFHand, margin: float) -> JointLimitMargins:
        """Return the margins of a hand's joints, given one margin in radians."""
        limits, joints = hand.tree.joint_limits, hand.robot.free_joints
        largest = SHARE * (limits[1] - limits[0])
        revolute = np.array([joint.is_revolute for joint in joints])
        wanted = np.where(revolute, np.minimum(margin, largest), largest)
        return cls(tuple(joint.name for joint in joints), limits, wanted)

    def distances_to_limits(self, joints: FloatArray) -> FloatArray:
        """Return the distance of each joint (m,) from its nearer limit, (m,)."""
        return np.asarray(np.minimum(joints - self.limits[0], self.limits[1] - joints))

    def distances_by_name(self, joints: FloatArray) -> dict[str, float]:
        """Return the distance of each joint (m,) from its nearer limit, by name."""
        return dict(zip(self.names, self.distances_to_limits(joints).tolist(), strict=True))

    def margins_record(self, joints: FloatArray, margin: float, price: float) -> JointMargins:
        """Return the record of the required margins and of the distances of joints (m,) from their limits."""
        return JointMargins(
            margin, dict(zip(self.names, self.wanted.tolist(), strict=True)), self.distances_by_name(joints), price
        )

    def is_below_margin(self, joints: FloatArray) -> BoolArray:
        """Return the mask of joints (m,) nearer to a limit than their margin, (m,)."""
        return np.asarray(self.distances_to_limits(joints) < (1.0 - SMALL) * self.wanted)

    def narrow_limits(self, joints: BoolArray) -> FloatArray:
        """Return the joint limits (2, m), narrowed by the margins of the joints in a mask (m,)."""
        margins = np.where(joints, self.wanted, 0.0)
        return np.stack([self.limits[0] + margins, self.limits[1] - margins])
