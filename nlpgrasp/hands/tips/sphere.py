"""Spherical fingertip, fixed to a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.rows import Row
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.hands.tips.base import TILT, Tip, Touch, equal


@dataclass(frozen=True)
class SphereTip(Tip):
    """A sphere fixed to a link, with the constraint ``c(q) = p - r n`` (docs/hands.md).

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    offset : (3,) array
        Centre, metres, link frame.
    """

    kind: ClassVar[str] = "sphere"
    radius: float
    offset: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number("SphereTip.radius", self.radius, above=0.0))
        object.__setattr__(self, "offset", tuple(array("SphereTip.offset", self.offset, (3,)).tolist()))

    @property
    def centre(self) -> FloatArray:
        """Centre of the sphere, (3,), metres, link frame."""
        return np.asarray(self.offset, dtype=float)

    @property
    def standoff(self) -> float:
        """Radius of the sphere, metres."""
        return self.radius

    def ball_centre(self, pose: Expression, slide: Expression) -> Expression:
        """Return the sphere's centre, body frame."""
        return pose[:3, 3] + ca.mtimes(pose[:3, :3], ca.DM(self.centre))

    def rows(self, touch: Touch) -> list[Row]:
        """Return the constraints ``c = p - r n``."""
        return equal(touch, self.ball_centre(touch.pose, None), touch.p - self.radius * touch.n)

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (m, 3) outside the sphere, (m,), metres."""
        return np.asarray(np.linalg.norm(points - self.centre, axis=1) - self.radius)

    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return radii for points (m, 3), (m,), metres, within a cone of 20 degrees around the sphere."""
        return np.asarray(self.radius + TILT * np.linalg.norm(centres - self.centre, axis=1))

    def to_dict(self) -> Json:
        """Return radius and offset as JSON data."""
        return {"type": self.kind, "radius": self.radius, "offset": list(self.centre)}
