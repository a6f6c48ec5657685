"""Candidate: contacts and hand configuration, the iterate of every stage of a solve."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values


@dataclass(frozen=True)
class Placed:
    """Contacts on faces of the body, and the hand's configuration.

    Parameters
    ----------
    faces : tuple of k str
        The face each contact is on.
    points : (k, space) array
        Metres, body frame.
    hand : dict
        Values of the hand's variables, in the hand's units; empty without a hand.
    """

    faces: tuple[str, ...]
    points: FloatArray
    hand: Values = field(default_factory=dict)

    def repeated_hand(self, count: int) -> Values:
        """Return the hand's values repeated ``count`` times, (count, m) each: for placements that share the hand."""
        return {name: np.repeat(value[None], count, axis=0) for name, value in self.hand.items()}
