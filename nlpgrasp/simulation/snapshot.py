"""State of a simulation at one time, and the limits beyond which a grasp is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray

MOST_SLIP, MOST_TURN = 2e-3, float(np.radians(3.0))  # metres and radians: limits beyond which a grasp is lost


@dataclass(frozen=True)
class Snapshot:
    """State of a simulation at one time.

    Parameters
    ----------
    time : float
        Seconds.
    slip : float
        Largest distance of a contact point on the body from its fingertip, metres.
    turn : float
        Rotation of the body, radians.
    used : float
        Used share of the hand's effort.
    rotation, position : (3, 3) and (3,) array
        The body's pose.
    tips : (k, 3) array
        Displacement of each fingertip.
    """

    time: float
    slip: float
    turn: float
    used: float
    rotation: FloatArray
    position: FloatArray
    tips: FloatArray

    @property
    def lost(self) -> bool:
        """Whether the body's slip or rotation exceeds its limit."""
        return self.beyond(1.0)

    def beyond(self, share: float) -> bool:
        """Return whether slip or turn has reached a share of its limit."""
        return self.slip >= share * MOST_SLIP or self.turn >= share * MOST_TURN
