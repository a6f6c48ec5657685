"""One time of a run, and what counts as lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray

MOST_SLIP, MOST_TURN = 2e-3, float(np.radians(3.0))  # metres and radians: more is lost


@dataclass(frozen=True)
class Snapshot:
    """One time of a run.

    Parameters
    ----------
    time : float
        Seconds.
    slip : float
        Largest way that a point of contact on the body has gone from its fingertip, metres.
    turn : float
        How far the body has turned, radians.
    used : float
        Share of the hand's effort.
    rotation, position : (3, 3) and (3,) array
        The body's pose.
    tips : (k, 3) array
        How far each fingertip has moved.
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
        """Whether the body has slipped or turned too far."""
        return self.beyond(1.0)

    def beyond(self, share: float) -> bool:
        """Whether slip or turn has reached this share of what counts as lost."""
        return self.slip >= share * MOST_SLIP or self.turn >= share * MOST_TURN
