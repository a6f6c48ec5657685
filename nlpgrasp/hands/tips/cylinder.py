"""Cylindrical fingertip: contact anywhere along the side of a finger link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.rows import Row
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.tips.base import SLACK, Tip, Touch, equal
from nlpgrasp.hands.tips.patches import FINE, tube


@dataclass(frozen=True)
class CylinderTip(Tip):
    """The side of a cylinder between two points of its axis, with the position along it as sliding coordinate.

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    start, end : (3,) array
        Ends of the axis, metres, link frame.
    """

    kind: ClassVar[str] = "cylinder"
    radius: float
    start: ArrayLike
    end: ArrayLike

    def __post_init__(self) -> None:
        field = type(self).__name__
        object.__setattr__(self, "radius", number(f"{field}.radius", self.radius, above=0.0))
        ends = [array(f"{field}.{name}", getattr(self, name), (3,)) for name in ("start", "end")]
        if np.linalg.norm(ends[1] - ends[0]) < 1e-9:
            raise InputError(f"{field}.end", self.end, "another point than the start")
        for name, value in zip(("start", "end"), ends, strict=True):
            object.__setattr__(self, name, tuple(value.tolist()))

    @property
    def ends(self) -> FloatArray:
        """Both ends of the axis, (2, 3), metres, link frame."""
        return np.array([self.start, self.end], dtype=float)

    @property
    def centre(self) -> FloatArray:
        """Middle of the axis, (3,), metres, link frame."""
        return np.asarray(self.ends.mean(axis=0))

    @property
    def standoff(self) -> float:
        """Radius of the cylinder, metres."""
        return self.radius

    @property
    def slides(self) -> bool:
        """True, because the contact may be anywhere along the axis."""
        return True

    def slide_at(self, point: FloatArray) -> float:
        """Return the contact's position along the axis, as a share of its length."""
        a, b = self.ends
        return float(np.clip((point - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0))

    def ball_centre(self, pose: Expression, slide: Expression) -> Expression:
        """Return the point of the axis behind the contact, body frame."""
        a, b = self.ends
        return pose[:3, 3] + ca.mtimes(pose[:3, :3], ca.DM(a) + slide * ca.DM(b - a))

    def rows(self, touch: Touch) -> list[Row]:
        """Return the constraints ``a + s (b - a) = p - r n`` and ``n`` perpendicular to the axis."""
        a, b = self.ends
        along = ca.mtimes(touch.pose[:3, :3], ca.DM((b - a) / np.linalg.norm(b - a)))
        return [
            *equal(touch, self.ball_centre(touch.pose, touch.slide), touch.p - self.radius * touch.n),
            touch.row("across", ca.dot(along, touch.n), 0.0, 0.0),
        ]

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (m, 3) outside the cylinder with round ends, (m,), metres."""
        a, b = self.ends
        t = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0)
        return np.asarray(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1) - self.radius)

    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return the largest radii of spheres about points (m, 3) within the cylinder's own radius, (m,), metres."""
        a, b = self.ends
        t = np.clip((centres - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0)
        off = np.linalg.norm(centres - a - t[:, None] * (b - a), axis=1)
        return np.asarray(np.maximum(self.radius - off - SLACK, 0.0))

    @property
    def backbone(self) -> FloatArray:
        """Points along the axis, (9, 3), metres, link frame."""
        start, end = self.ends
        return np.asarray(np.linspace(start, end, 9))

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the side of the cylinder as triangles."""
        start, end = self.ends
        return tube(self.radius, start, end, sides)

    def to_dict(self) -> Json:
        """Return radius and ends."""
        return {"type": self.kind, "radius": self.radius, "start": list(self.ends[0]), "end": list(self.ends[1])}
