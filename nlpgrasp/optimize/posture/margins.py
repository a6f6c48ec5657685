"""Joint-limit margins: required and actual distances of joints from their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.solution.joint_room import SMALL, JointRoom

SHARE = 0.1  # share of a joint's range: upper bound on its margin


@dataclass(frozen=True)
class Margins:
    """Free joints of a hand with their limits and required margins.

    Parameters
    ----------
    names : tuple of m str
    limits : (2, m) array
        Radians, metres of joints that slide.
    wanted : (m,) array
        A tenth of each range at most, and exactly that of joints that slide.
    """

    names: tuple[str, ...]
    limits: FloatArray
    wanted: FloatArray

    @classmethod
    def of(cls, hand: URDFHand, margin: float) -> Margins:
        """Return the margins of a hand's joints, from a margin in radians."""
        limits, joints = hand.tree.joint_limits, hand.robot.free_joints
        share = SHARE * (limits[1] - limits[0])
        turns = np.array([joint.turns for joint in joints])
        wanted = np.where(turns, np.minimum(margin, share), share)
        return cls(tuple(joint.name for joint in joints), limits, wanted)

    def left(self, joints: FloatArray) -> FloatArray:
        """Return the distances of joints (m,) from their nearer limits, (m,)."""
        return np.asarray(np.minimum(joints - self.limits[0], self.limits[1] - joints))

    def left_by_name(self, joints: FloatArray) -> dict[str, float]:
        """Return the distances of joints (m,) from their nearer limits, by name."""
        return dict(zip(self.names, self.left(joints).tolist(), strict=True))

    def room(self, joints: FloatArray, margin: float, price: float) -> JointRoom:
        """Return the joint-limit margins of joints (m,) as files state them, beside the required ones."""
        return JointRoom(
            margin, dict(zip(self.names, self.wanted.tolist(), strict=True)), self.left_by_name(joints), price
        )

    def lacking(self, joints: FloatArray) -> NDArray[np.bool_]:
        """Return the mask of joints (m,) with less than their margin, (m,)."""
        return np.asarray(self.left(joints) < (1.0 - SMALL) * self.wanted)

    def narrowed(self, chosen: NDArray[np.bool_]) -> FloatArray:
        """Return the limits, (2, m), narrowed by the margins of the chosen joints, (m,) of bool."""
        inside = np.where(chosen, self.wanted, 0.0)
        return np.stack([self.limits[0] + inside, self.limits[1] - inside])
