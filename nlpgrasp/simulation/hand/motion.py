"""How far an object has moved in a hand, and what counts as held."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlpgrasp.common.validation import FloatArray

STRICT, LOOSE = (0.01, float(np.radians(10.0))), (0.05, float(np.radians(15.0)))  # metres and radians
GONE = 1.0  # metres: an object this far away is lost, and no number says more
NONE = 0.005  # millimetres and degrees that are none in words


@dataclass(frozen=True)
class Motion:
    """How far an object has moved.

    Parameters
    ----------
    slip : float
        Of its centre of mass, metres.
    turn : float
        Radians.
    """

    slip: float = 0.0
    turn: float = 0.0

    def within(self, limits: tuple[float, float]) -> bool:
        """Return whether both are at most what is given, metres and radians; false for no numbers."""
        return self.slip <= limits[0] and self.turn <= limits[1]

    @property
    def gone(self) -> bool:
        """Whether the object is so far away that no number says more."""
        return not self.slip < GONE

    def __add__(self, after: Motion) -> Motion:
        """Return the most that a motion and another after it come to."""
        return Motion(self.slip + after.slip, self.turn + after.turn)

    @classmethod
    def largest(cls, all_of: Iterable[Motion]) -> Motion:
        """Return the largest slip and the largest turn; none where there is nothing."""
        return reduce(lambda a, b: cls(max(a.slip, b.slip), max(a.turn, b.turn)), all_of, cls())

    def __str__(self) -> str:
        if self.gone:
            return "lost"
        return f"{_told(1e3 * self.slip)} mm, {_told(np.degrees(self.turn))} deg"


def _told(number: float) -> str:
    """Return a number of two figures, or all before the point."""
    return "0" if number < NONE else f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"


@dataclass(frozen=True)
class Pose:
    """Where an object is in a hand.

    Parameters
    ----------
    position : (3,) array
        Of its centre of mass, metres, palm frame.
    rotation : (3, 3) array
        Palm frame.
    """

    position: FloatArray
    rotation: FloatArray

    def from_(self, before: Pose) -> Motion:
        """Return how far it has moved from a pose before."""
        cosine = (np.trace(self.rotation @ before.rotation.T) - 1.0) / 2.0
        return Motion(
            float(np.linalg.norm(self.position - before.position)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        )
