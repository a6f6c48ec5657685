"""Ellipsoidal fingertip: a convex patch."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.angles import angle
from nlpgrasp.common.given.pose import Pose
from nlpgrasp.common.rows import Row
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.hands.tips.base import TILT, Tip, Touch, equal, frame_of, offset_and_rpy
from nlpgrasp.hands.tips.patches import FINE, dome


@dataclass(frozen=True)
class EllipsoidTip(Tip):
    """The patch of an ellipsoid whose outward normals are within an angle of a direction.

    With A = diag(semi-axes) and the normal m in the ellipsoid's axes, the point with that normal is
    ``A^2 m / |A m|`` (the gradient of the support function).

    Parameters
    ----------
    semi_axes : (3,) array
        Metres, greater than zero.
    offset, rpy : (3,) array
        Pose of the ellipsoid in the link's frame, metres and radians.
    pose : (4, 4) array or mapping, optional
        The same pose instead, as a matrix or as ``position`` with ``quaternion_wxyz`` or ``quaternion_xyzw``.
    facing : (3,) array, optional
        Middle of the patch: an outward direction in the ellipsoid's frame; the whole ellipsoid when left out.
    angle : float
        Radians from ``facing``, up to pi.
    """

    kind: ClassVar[str] = "ellipsoid"
    semi_axes: ArrayLike
    offset: ArrayLike = (0.0, 0.0, 0.0)
    rpy: ArrayLike = (0.0, 0.0, 0.0)
    facing: ArrayLike | None = None
    angle: float = np.pi / 2.0
    pose: InitVar[Pose | None] = field(default=None, kw_only=True)

    def __post_init__(self, pose: Pose | None) -> None:
        axes = array("EllipsoidTip.semi_axes", self.semi_axes, (3,))
        if np.any(axes <= 0.0):
            raise InputError("EllipsoidTip.semi_axes", axes.tolist(), "three lengths above zero")
        object.__setattr__(self, "semi_axes", tuple(axes.tolist()))
        offset, rpy = offset_and_rpy("EllipsoidTip", self.offset, self.rpy, pose)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "rpy", rpy)
        object.__setattr__(self, "angle", angle("EllipsoidTip.angle", self.angle, np.pi, "pi"))
        if self.facing is not None:
            direction = array("EllipsoidTip.facing", self.facing, (3,))
            length = float(np.linalg.norm(direction))
            if length == 0.0:
                raise InputError("EllipsoidTip.facing", self.facing, "a direction")
            object.__setattr__(self, "facing", tuple((direction / length).tolist()))

    @property
    def centre(self) -> FloatArray:
        """Centre of the ellipsoid, (3,), metres, link frame."""
        return np.asarray(self.offset, dtype=float)

    def rows(self, touch: Touch) -> list[Row]:
        """Return the constraint ``p = t + R A^2 m / |A m|`` with ``m = R^T n``, and the patch's limit."""
        here = ca.mtimes(touch.pose, ca.DM(frame_of("EllipsoidTip", self.offset, self.rpy)))
        m = ca.mtimes(here[:3, :3].T, touch.n)
        scaled = ca.DM(np.asarray(self.semi_axes)) * m
        point = here[:3, 3] + ca.mtimes(here[:3, :3], ca.DM(np.asarray(self.semi_axes)) * scaled) / ca.norm_2(scaled)
        rows = equal(touch, point, touch.p)
        if self.facing is not None:
            towards = ca.dot(ca.DM(np.asarray(self.facing)), m)
            rows.append(touch.row("within the patch", towards, float(np.cos(self.angle))))
        return rows

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return an upper bound on the distance of points (m, 3) outside the ellipsoid, (m,), metres."""
        frame = frame_of("EllipsoidTip", self.offset, self.rpy)
        axes = np.asarray(self.semi_axes, dtype=float)
        gauge = np.linalg.norm((points - frame[:3, 3]) @ frame[:3, :3] / axes, axis=1)
        return np.asarray((gauge - 1.0) * np.max(axes))

    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return radii for points (m, 3), (m,), metres, within a cone of 20 degrees around the smallest semi-axis."""
        smallest = float(np.min(self.semi_axes))
        return np.asarray(smallest + TILT * np.linalg.norm(centres - self.centre, axis=1))

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the patch as triangles, sampled by outward normals."""
        frame, axes = frame_of("EllipsoidTip", self.offset, self.rpy), np.asarray(self.semi_axes, dtype=float)
        facing = np.array([0.0, 0.0, 1.0]) if self.facing is None else np.asarray(self.facing, dtype=float)
        found = dome(facing, np.pi if self.facing is None else self.angle, sides)
        scaled = axes * found.vertices
        points = axes * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
        return Triangles(points @ frame[:3, :3].T + frame[:3, 3], found.faces)

    def to_dict(self) -> Json:
        """Return shape, pose and extent as JSON data."""
        return {
            "type": self.kind,
            "semi_axes": list(np.asarray(self.semi_axes, float)),
            "offset": list(np.asarray(self.offset, float)),
            "rpy": list(np.asarray(self.rpy, float)),
            "facing": None if self.facing is None else list(np.asarray(self.facing, float)),
            "angle": self.angle,
        }
