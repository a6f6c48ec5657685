"""Motion of an object relative to the hand, and limits for a held object."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlpgrasp.common.validation import FloatArray

STRICT, LOOSE = (0.01, float(np.radians(10.0))), (0.05, float(np.radians(15.0)))  # metres and radians of a held object
GONE = 1.0  # metres: an object this far away is lost, and its motion not reported
NONE = 0.005  # millimetres and degrees: smaller motions are reported as none


@dataclass(frozen=True)
class Motion:
    """Displacement and rotation of an object.

    Parameters
    ----------
    slip : float
        Displacement of its centre of mass, metres.
    turn : float
        Rotation angle, radians.
    """

    slip: float = 0.0
    turn: float = 0.0

    def within(self, limits: tuple[float, float]) -> bool:
        """Return whether both are at most the limits, metres and radians; False for NaN."""
        return self.slip <= limits[0] and self.turn <= limits[1]

    @property
    def gone(self) -> bool:
        """Whether the object is so far away that its motion is not reported."""
        return not self.slip < GONE

    def __add__(self, after: Motion) -> Motion:
        """Return an upper bound on this motion followed by another."""
        return Motion(self.slip + after.slip, self.turn + after.turn)

    @classmethod
    def largest(cls, all_of: Iterable[Motion]) -> Motion:
        """Return the largest slip and the largest turn; zero for no motions."""
        return reduce(lambda a, b: cls(max(a.slip, b.slip), max(a.turn, b.turn)), all_of, cls())

    def __str__(self) -> str:
        if self.gone:
            return "lost"
        return f"{_told(1e3 * self.slip)} mm, {_told(np.degrees(self.turn))} deg"


def _told(number: float) -> str:
    """Return a number as text with two significant figures, or all digits before the point."""
    return "0" if number < NONE else f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"


@dataclass(frozen=True)
class Pose:
    """Pose of an object in a hand.

    Parameters
    ----------
    position : (3,) array
        Of its centre of mass, metres, palm frame.
    rotation : (3, 3) array
        Orientation, palm frame.
    """

    position: FloatArray
    rotation: FloatArray

    def from_(self, before: Pose) -> Motion:
        """Return the motion from an earlier pose."""
        cosine = (np.trace(self.rotation @ before.rotation.T) - 1.0) / 2.0
        return Motion(
            float(np.linalg.norm(self.position - before.position)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        )
