"""Flat fingertip: a pad, or a part of the palm."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.pose import Pose
from nlpgrasp.common.rows import Row
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.hands.tips.base import SLACK, Tip, Touch, frame_of, offset_and_rpy
from nlpgrasp.hands.tips.patches import FINE, rectangle


@dataclass(frozen=True)
class FlatTip(Tip):
    """A flat rectangle whose outward normal is the z axis of its own frame.

    Parameters
    ----------
    extents : (2,) array
        Full lengths along x and y, metres, greater than zero.
    offset, rpy : (3,) array
        Pose of the rectangle's middle in the link's frame, metres and radians.
    pose : (4, 4) array or mapping, optional
        The same pose instead, as a matrix or as ``position`` with ``quaternion_wxyz`` or ``quaternion_xyzw``.
    """

    kind: ClassVar[str] = "flat"
    extents: ArrayLike
    offset: ArrayLike = (0.0, 0.0, 0.0)
    rpy: ArrayLike = (0.0, 0.0, 0.0)
    pose: InitVar[Pose | None] = field(default=None, kw_only=True)

    def __post_init__(self, pose: Pose | None) -> None:
        extents = array("FlatTip.extents", self.extents, (2,))
        if np.any(extents <= 0.0):
            raise InputError("FlatTip.extents", extents.tolist(), "two lengths above zero")
        object.__setattr__(self, "extents", tuple(extents.tolist()))
        offset, rpy = offset_and_rpy("FlatTip", self.offset, self.rpy, pose)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "rpy", rpy)

    @property
    def frame(self) -> FloatArray:
        """Pose of the rectangle in the link's frame, (4, 4)."""
        return frame_of("FlatTip", self.offset, self.rpy)

    @property
    def centre(self) -> FloatArray:
        """Middle of the rectangle, (3,), metres, link frame."""
        return np.asarray(self.offset, dtype=float)

    @property
    def normal(self) -> FloatArray:
        """Outward unit normal of the rectangle, (3,), link frame."""
        return np.asarray(self.frame[:3, 2])

    def rows(self, touch: Touch) -> list[Row]:
        """Return constraints: equal normals, and the contact in the plane and within the rectangle."""
        here = ca.mtimes(touch.pose, ca.DM(self.frame))
        local = ca.mtimes(here[:3, :3].T, touch.p - here[:3, 3])
        m = ca.mtimes(here[:3, :3].T, touch.n)
        half = np.asarray(self.extents, dtype=float) / 2.0
        return [
            touch.row("normal x", m[0], 0.0, 0.0),
            touch.row("normal y", m[1], 0.0, 0.0),
            touch.row("facing", m[2]),
            touch.row("plane", local[2], 0.0, 0.0, length=True),
            touch.row("extent x", local[0], -half[0], half[0], length=True),
            touch.row("extent y", local[1], -half[1], half[1], length=True),
        ]

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (m, 3) in front of the pad's plane, (m,), metres."""
        frame = self.frame
        return np.asarray((points - frame[:3, 3]) @ frame[:3, 2])

    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return the distance of points (m, 3) behind the pad's plane, (m,), metres."""
        frame = self.frame
        return np.asarray(np.maximum(-(centres - frame[:3, 3]) @ frame[:3, 2] - SLACK, 0.0))

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the rectangle as triangles."""
        return rectangle(np.asarray(self.extents, dtype=float), self.frame, max(2, sides // 3))

    def to_dict(self) -> Json:
        """Return extents and pose as JSON data."""
        return {
            "type": self.kind,
            "extents": list(np.asarray(self.extents, float)),
            "offset": list(np.asarray(self.offset, float)),
            "rpy": list(np.asarray(self.rpy, float)),
        }
