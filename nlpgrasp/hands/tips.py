"""Fingertip geometries: the patch of a link's surface that may touch the body."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp

from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.scalar_constraints import ON_FINGERTIP, ScalarConstraint
from nlpgrasp.common.spatial import Pose, pose_matrix, tangents
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, angle, array, check_angles, number
from nlpgrasp.errors import InputError

FINE = 28  # sides of a round patch in pictures
DOT_RADIUS = 2e-3  # metres: radius of the ball drawn for a patch of unknown shape
CAPSULE_DEPTH = 1e-4  # largest depth of a contact inside the capsule, as a share of the axis' length


class Tip(ABC):
    """A convex patch of a link's surface that touches the body.

    At the contact the patch's outward normal is the body's inward normal n, and the point of the patch with
    that normal is the contact point p.

    A new kind also needs an entry by its ``kind`` in ``TIP_CONSTRAINTS`` of ``verify/numeric_urdf_hand.py`` and, to be
    simulated, in ``KINDS`` of ``simulation/robot_hand_scene.py``.
    """

    kind: ClassVar[str]

    @property
    @abstractmethod
    def centre(self) -> FloatArray:
        """Point (3,) on or behind the middle of the patch, metres, link frame.

        While the hand is posed, a ball of radius ``posing_radius`` about it replaces the patch.
        """

    @property
    def standoff(self) -> float:
        """Distance of the contact from the ball centre behind it, metres; 0 for patches that are not round."""
        return 0.0

    @property
    def posing_radius(self) -> float:
        """Radius of the ball about ``centre`` that replaces the patch while the hand is posed, metres."""
        return self.standoff

    @property
    def normal(self) -> FloatArray | None:
        """Outward unit normal of a flat patch, (3,), link frame; None for a curved one."""
        return None

    @property
    def half_sides(self) -> FloatArray:
        """Halves of sides or axis along which a contact slides, (m, 3), metres, link frame; none of a ball."""
        return np.zeros((0, 3))

    @property
    def middle(self) -> FloatArray:
        """Where these halves begin, (3,), metres, link frame."""
        return self.centre

    @property
    def slides(self) -> bool:
        """Whether the patch has a sliding coordinate, from 0 to 1."""
        return False

    @property
    def initial_slide(self) -> float:
        """Initial sliding coordinate, which puts the ball at ``centre``."""
        return 0.5

    def slide_at(self, point: FloatArray) -> float:
        """Return the sliding coordinate of a contact (3,), metres, link frame."""
        del point
        return self.initial_slide

    def ball_centre(self, pose: Expression, slide: Expression) -> Expression | None:
        """Return the centre of the ball behind the contact, body frame, given the link's pose; None without a ball."""
        return None

    @abstractmethod
    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return the constraints that the contact lies on the patch."""

    @abstractmethod
    def beyond(self, points: FloatArray) -> FloatArray:
        """Return signed distances of points (m, 3), link frame, from the patch's solid, metres, negative inside."""

    @property
    def backbone(self) -> FloatArray:
        """Centres of the balls of radius ``standoff`` that stand for the patch, (m, 3), metres, link frame."""
        return self.centre[None]

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the patch as triangles facing outwards, in the link's frame; by default a ball.

        Parameters
        ----------
        sides : int
            Of what is round.
        """
        ball = dome(np.array([0.0, 0.0, 1.0]), np.pi, sides)
        return Triangles(self.centre + (self.standoff or DOT_RADIUS) * ball.vertices, ball.faces)

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the patch as JSON data."""


@dataclass(frozen=True)
class SymbolicTouch:
    """A fingertip's contact with the body: symbolic link pose, contact point and normal.

    Parameters
    ----------
    link : str
        The link's name.
    finger : int
        Number of the contact.
    pose : casadi.SX
        (4, 4) transform from the link's frame to the body's.
    p, n : casadi.SX
        Contact point and inward normal, body frame.
    slide : casadi.SX or None
        The patch's own coordinate.
    size : float
        The body's characteristic length, for scaling.
    """

    link: str
    finger: int
    pose: Expression
    p: Expression
    n: Expression
    slide: Expression
    size: float

    def row(
        self, part: str, expression: Expression, lower: float = 0.0, upper: float = np.inf, *, length: bool = False
    ) -> ScalarConstraint:
        """Return a scalar constraint of the fingertip, on a length in metres or a dimensionless number."""
        scale, unit = (self.size, "m") if length else (1.0, "")
        return ScalarConstraint(
            ON_FINGERTIP, expression, lower, upper, scale, unit, fingers=(self.finger,), link=self.link, part=part
        )


@dataclass(frozen=True)
class SphereTip(Tip):
    """A spherical fingertip fixed to a link, with the constraint ``c(q) = p - r n`` (docs/hands.md).

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

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return the constraints ``c = p - r n``."""
        return equality_constraints(touch, self.ball_centre(touch.pose, None), touch.p - self.radius * touch.n)

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3) from the sphere, (m,), metres, negative inside."""
        return np.asarray(np.linalg.norm(points - self.centre, axis=1) - self.radius)

    def to_dict(self) -> Json:
        """Return radius and offset as JSON data."""
        return {"type": self.kind, "radius": self.radius, "offset": list(self.centre)}


@dataclass(frozen=True)
class CylinderTip(Tip):
    """A cylindrical fingertip: the side of a cylinder, with the position along the axis as sliding coordinate.

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
    def middle(self) -> FloatArray:
        """Middle of the axis, (3,), metres, link frame."""
        return np.asarray(self.ends.mean(axis=0))

    @property
    def half_sides(self) -> FloatArray:
        """Half of the axis, (1, 3), metres, link frame."""
        return (self.ends[1:] - self.ends[:1]) / 2.0

    @property
    def centre(self) -> FloatArray:
        """Middle of the axis, (3,), metres, link frame."""
        return self.middle

    @property
    def standoff(self) -> float:
        """Radius of the cylinder, metres."""
        return self.radius

    @property
    def slides(self) -> bool:
        """Always true: the contact may be anywhere along the axis."""
        return True

    def slide_at(self, point: FloatArray) -> float:
        """Return the contact's position along the axis, as a fraction of its length."""
        a, b = self.ends
        return float(np.clip((point - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0))

    def ball_centre(self, pose: Expression, slide: Expression) -> Expression:
        """Return the centre of the ball, on the axis behind the contact, body frame."""
        a, b = self.ends
        return pose[:3, 3] + ca.mtimes(pose[:3, :3], ca.DM(a) + slide * ca.DM(b - a))

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return the constraints ``a + s (b - a) = p - r n`` and ``n`` perpendicular to the axis."""
        a, b = self.ends
        along = ca.mtimes(touch.pose[:3, :3], ca.DM((b - a) / np.linalg.norm(b - a)))
        return [
            *equality_constraints(touch, self.ball_centre(touch.pose, touch.slide), touch.p - self.radius * touch.n),
            touch.row("across", ca.dot(along, touch.n), 0.0, 0.0),
        ]

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3) from the cylinder with round ends, (m,), metres."""
        a, b = self.ends
        t = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0)
        return np.asarray(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1) - self.radius)

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
        """Return radius and ends as JSON data."""
        return {"type": self.kind, "radius": self.radius, "start": list(self.ends[0]), "end": list(self.ends[1])}


@dataclass(frozen=True)
class CapsuleTip(CylinderTip):
    """A capsule fingertip: the side and both round ends of a capsule.

    With s from 0 to 1 along the axis and v = u . n the contact normal's share of the axis' direction u,
    ``a + s (b - a) = p - r n`` puts a ball that touches at p on the axis. It touches where the capsule does, if v = 0
    within the axis, v >= 0 at b and v <= 0 at a: ``(1 - s) max(v, 0) = 0`` and ``s max(-v, 0) = 0``. The program has
    ``(1 - s) v <= e`` and ``-s v <= e`` with e = 1e-4, which are smooth and have interior points; p is then inside the
    capsule by at most e times the axis' length (docs/hands.md).

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    start, end : (3,) array
        Centres of the round ends, metres, link frame; searches begin at ``end``, the finger's.
    """

    kind: ClassVar[str] = "capsule"

    @property
    def centre(self) -> FloatArray:
        """Centre of the distal round end, (3,), metres, link frame: the usual place of contact."""
        return np.array(self.end, dtype=float)

    @property
    def initial_slide(self) -> float:
        """Initial sliding coordinate 1: the distal end."""
        return 1.0

    def surface(self, sides: int = FINE) -> Triangles:
        """Return side and round ends as triangles."""
        start, end = self.ends
        along = (end - start) / np.linalg.norm(end - start)
        caps = [(start, dome(-along, 0.5 * np.pi, sides)), (end, dome(along, 0.5 * np.pi, sides))]
        parts = [tube(self.radius, start, end, sides)]
        parts += [Triangles(centre + self.radius * cap.vertices, cap.faces) for centre, cap in caps]
        first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        faces = [part.faces + number for part, number in zip(parts, first, strict=True)]
        return Triangles(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return the constraints that the capsule touches the contact point with its side or a round end.

        ``a + s (b - a) = p - r n``, where n tilts beyond the perpendicular of the axis only at the ends.
        """
        a, b = self.ends
        along = ca.mtimes(touch.pose[:3, :3], ca.DM((b - a) / np.linalg.norm(b - a)))
        leans = ca.dot(along, touch.n)
        return [
            *equality_constraints(touch, self.ball_centre(touch.pose, touch.slide), touch.p - self.radius * touch.n),
            touch.row("over the end", (1.0 - touch.slide) * leans, -np.inf, CAPSULE_DEPTH),
            touch.row("over the start", -touch.slide * leans, -np.inf, CAPSULE_DEPTH),
        ]


@dataclass(frozen=True)
class EllipsoidTip(Tip):
    """An ellipsoidal fingertip: the patch with outward normals within an angle of a direction.

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
        offset, rpy = check_offset("EllipsoidTip", self.offset, self.rpy, pose)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "rpy", rpy)
        object.__setattr__(self, "angle", angle("EllipsoidTip.angle", self.angle, np.pi, "pi"))
        if self.facing is not None:
            object.__setattr__(self, "facing", _unit_direction("EllipsoidTip.facing", self.facing))

    @property
    def centre(self) -> FloatArray:
        """Centre of the ellipsoid, (3,), metres, link frame."""
        return np.asarray(self.offset, dtype=float)

    @property
    def posing_radius(self) -> float:
        """Smallest semi-axis of the ellipsoid, metres."""
        return float(np.min(self.semi_axes))

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return ``p = t + R A^2 m / |A m|`` with ``m = R^T n``, and the limit of the patch."""
        frame = ca.mtimes(touch.pose, ca.DM(tip_frame("EllipsoidTip", self.offset, self.rpy)))
        m = ca.mtimes(frame[:3, :3].T, touch.n)
        scaled = ca.DM(np.asarray(self.semi_axes)) * m
        point = frame[:3, 3] + ca.mtimes(frame[:3, :3], ca.DM(np.asarray(self.semi_axes)) * scaled) / ca.norm_2(scaled)
        rows = equality_constraints(touch, point, touch.p)
        if self.facing is not None:
            towards = ca.dot(ca.DM(np.asarray(self.facing)), m)
            rows.append(touch.row("within the patch", towards, float(np.cos(self.angle))))
        return rows

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return upper bounds on the distances of points (m, 3) outside the ellipsoid, (m,), metres."""
        frame = tip_frame("EllipsoidTip", self.offset, self.rpy)
        axes = np.asarray(self.semi_axes, dtype=float)
        gauge = np.linalg.norm((points - frame[:3, 3]) @ frame[:3, :3] / axes, axis=1)
        return np.asarray((gauge - 1.0) * np.max(axes))

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the patch as triangles, sampled by outward normals."""
        frame, axes = tip_frame("EllipsoidTip", self.offset, self.rpy), np.asarray(self.semi_axes, dtype=float)
        facing = np.array([0.0, 0.0, 1.0]) if self.facing is None else np.asarray(self.facing, dtype=float)
        unit_dome = dome(facing, np.pi if self.facing is None else self.angle, sides)
        scaled = axes * unit_dome.vertices
        points = axes * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
        return Triangles(points @ frame[:3, :3].T + frame[:3, 3], unit_dome.faces)

    def to_dict(self) -> Json:
        """Return semi-axes, pose and extent as JSON data."""
        return {
            "type": self.kind,
            "semi_axes": list(np.asarray(self.semi_axes, float)),
            "offset": list(np.asarray(self.offset, float)),
            "rpy": list(np.asarray(self.rpy, float)),
            "facing": None if self.facing is None else list(np.asarray(self.facing, float)),
            "angle": self.angle,
        }


@dataclass(frozen=True)
class HullTip(Tip):
    """A fingertip on a rounded convex hull: the patch with outward normals within an angle of a direction.

    The hull of points v_i is given by its support function ``max_i v_i . m``, smoothed to
    ``h(m) = e log sum_i exp(v_i . m / e)`` for unit normals m, which exceeds it by at most ``e log(number of points)``.
    With the weights ``w_i = exp((v_i . m - h(m)) / e)`` the point with the normal m is
    ``V w + (h(m) - m . V w) m``, the gradient of the support function ``|m| h(m / |m|)``.

    Parameters
    ----------
    points : (n, 3) array
        Corners of the hull, metres, link frame.
    facing : (3,) array
        Middle of the patch: an outward direction in the link's frame.
    angle : float
        Radians from ``facing``, up to pi.
    rounding : float
        The length e, metres: small for sharp edges.
    """

    kind: ClassVar[str] = "hull"
    points: ArrayLike
    facing: ArrayLike
    angle: float = np.pi / 4.0
    rounding: float = 2e-4

    def __post_init__(self) -> None:
        points = array("HullTip.points", self.points, (None, 3))
        if not len(points):
            raise InputError("HullTip.points", "no points", "one at least")
        object.__setattr__(self, "points", tuple(map(tuple, points.tolist())))
        object.__setattr__(self, "angle", angle("HullTip.angle", self.angle, np.pi, "pi"))
        object.__setattr__(self, "rounding", number("HullTip.rounding", self.rounding, above=0.0))
        object.__setattr__(self, "facing", _unit_direction("HullTip.facing", self.facing))

    @cached_property
    def _ball(self) -> FloatArray:
        """Centre and radius of the ball that approximates the patch best, (4,), metres.

        Its support function is nearest to the hull's over the patch's normals.
        """
        normals, support = self._tangent_planes(self.angle, FINE)
        return np.asarray(np.linalg.lstsq(np.column_stack([normals, np.ones(len(normals))]), support, rcond=None)[0])

    @property
    def centre(self) -> FloatArray:
        """Centre of the ball that approximates the patch, (3,), metres, link frame."""
        return self._ball[:3]

    @property
    def posing_radius(self) -> float:
        """Radius of the ball that approximates the patch, metres."""
        return max(0.0, float(self._ball[3]))

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return constraints: the hull's point with outward normal n is p, and the limit of the patch."""
        corners, rotation = ca.DM(np.asarray(self.points)), touch.pose[:3, :3]
        m = ca.mtimes(rotation.T, touch.n)
        exponents = ca.mtimes(corners, m) / self.rounding
        total = ca.logsumexp(exponents)
        mean = ca.mtimes(corners.T, ca.exp(exponents - total))
        point = mean + (self.rounding * total - ca.dot(m, mean)) * m
        towards = ca.dot(ca.DM(np.asarray(self.facing)), m)
        return [
            *equality_constraints(touch, touch.pose[:3, 3] + ca.mtimes(rotation, point), touch.p),
            touch.row("within the patch", towards, float(np.cos(self.angle))),
        ]

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return signed distances of points (m, 3) from the patch's tangent planes, (m,), metres, negative inside."""
        normals, support = self._tangent_planes(np.pi, 2 * FINE)
        return np.asarray(np.max(points @ normals.T - support, axis=1))

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the patch as triangles, sampled by outward normals."""
        patch = dome(np.asarray(self.facing), self.angle, sides)
        return Triangles(self.points_with_normals(patch.vertices), patch.faces)

    def _tangent_planes(self, angle: float, sides: int) -> tuple[FloatArray, FloatArray]:
        """Return the patch's tangent planes: sampled normals (m, 3) and the corners' largest heights (m,) along these.

        The normals are within an angle of the patch's middle.
        """
        normals = dome(np.asarray(self.facing), angle, sides).vertices
        return normals, np.max(normals @ np.asarray(self.points).T, axis=1)

    def points_with_normals(self, normals: FloatArray) -> FloatArray:
        """Return the rounded hull's points with given outward unit normals (m, 3), (m, 3), metres, link frame."""
        corners = np.asarray(self.points)
        exponents = normals @ corners.T / self.rounding
        total = logsumexp(exponents, axis=1, keepdims=True)
        mean = np.exp(exponents - total) @ corners
        height = self.rounding * total[:, 0] - np.sum(normals * mean, axis=1)
        return np.asarray(mean + height[:, None] * normals)

    def to_dict(self) -> Json:
        """Return corners, rounding and extent as JSON data."""
        return {
            "type": self.kind,
            "points": np.asarray(self.points).tolist(),
            "facing": np.asarray(self.facing).tolist(),
            "angle": self.angle,
            "rounding": self.rounding,
        }


@dataclass(frozen=True)
class FlatTip(Tip):
    """A flat rectangular fingertip, whose outward normal is the z axis of its frame.

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
        offset, rpy = check_offset("FlatTip", self.offset, self.rpy, pose)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "rpy", rpy)

    @property
    def frame(self) -> FloatArray:
        """Pose of the rectangle in the link frame, (4, 4)."""
        return tip_frame("FlatTip", self.offset, self.rpy)

    @property
    def centre(self) -> FloatArray:
        """Middle of the rectangle, (3,), metres, link frame."""
        return np.asarray(self.offset, dtype=float)

    @property
    def normal(self) -> FloatArray:
        """Outward unit normal of the rectangle, (3,), link frame."""
        return np.asarray(self.frame[:3, 2])

    @property
    def half_sides(self) -> FloatArray:
        """Halves of the rectangle's sides, (2, 3), metres, link frame."""
        return np.asarray(self.frame[:3, :2] * (np.asarray(self.extents) / 2.0)).T

    def rows(self, touch: SymbolicTouch) -> list[ScalarConstraint]:
        """Return constraints: rectangle normal along n, contact in the plane and within the rectangle."""
        frame = ca.mtimes(touch.pose, ca.DM(self.frame))
        local = ca.mtimes(frame[:3, :3].T, touch.p - frame[:3, 3])
        m = ca.mtimes(frame[:3, :3].T, touch.n)
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
        """Return the signed distance of points (m, 3) in front of the rectangle's plane, (m,), metres."""
        frame = self.frame
        return np.asarray((points - frame[:3, 3]) @ frame[:3, 2])

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


def equality_constraints(touch: SymbolicTouch, left: Expression, right: Expression) -> list[ScalarConstraint]:
    """Return three scalar constraints ``left = right`` for columns of 3."""
    return [touch.row(axis, left[i] - right[i], 0.0, 0.0, length=True) for i, axis in enumerate("xyz")]


def tip_frame(field: str, offset: ArrayLike, rpy: ArrayLike) -> FloatArray:
    """Return the validated transform (4, 4) of an offset and roll, pitch, yaw."""
    pose = np.eye(4)
    pose[:3, 3] = array(f"{field}.offset", offset, (3,))
    turns = check_angles(f"{field}.rpy", array(f"{field}.rpy", rpy, (3,)))
    pose[:3, :3] = Rotation.from_euler("xyz", turns).as_matrix()
    return pose


def _unit_direction(field: str, given: ArrayLike) -> tuple[float, ...]:
    """Return a direction (3,) scaled to unit length; raise for a zero vector."""
    direction = array(field, given, (3,))
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        raise InputError(field, given, "a direction")
    return tuple((direction / length).tolist())


def check_offset(
    field: str, offset: ArrayLike, rpy: ArrayLike, pose: Pose | None
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the given offset and roll, pitch, yaw, or those of a given pose."""
    if pose is not None:
        if np.any(np.asarray(offset, dtype=object) != 0.0) or np.any(np.asarray(rpy, dtype=object) != 0.0):
            raise InputError(f"{field}.pose", "a pose beside offset or rpy", "one of them")
        frame = pose_matrix(f"{field}.pose", pose)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # roll and yaw are not unique at a pitch of a right angle
            offset, rpy = frame[:3, 3], Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
    tip_frame(field, offset, rpy)
    return tuple(np.asarray(offset, float).tolist()), tuple(np.asarray(rpy, float).tolist())


def dome(facing: FloatArray, angle: float, sides: int) -> Triangles:
    """Return the part of the unit sphere within an angle of a direction, as triangles.

    Parameters
    ----------
    facing : (3,) array
        Unit.
    angle : float
        Radians, up to pi: the whole sphere.
    sides : int
        Sides of each ring of triangles.
    """
    rings = max(2, round(sides * angle / (2.0 * np.pi)))
    polar, turn = np.linspace(0.0, angle, rings + 1), 2.0 * np.pi * np.arange(sides) / sides
    first, second = tangents(facing[None])[0]
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    points = np.cos(polar)[:, None, None] * facing + np.sin(polar)[:, None, None] * ring
    return Triangles(points.reshape(-1, 3), _ring_triangles(rings, sides))


def tube(radius: float, start: FloatArray, end: FloatArray, sides: int) -> Triangles:
    """Return the side of a cylinder between two points (3,) of its axis, as triangles."""
    steps = max(2, sides // 4)
    along = (end - start) / np.linalg.norm(end - start)
    first, second = tangents(along[None])[0]
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = radius * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)
    axis = start + np.linspace(1.0, 0.0, steps + 1)[:, None] * (end - start)  # the far end first: outward triangles
    return Triangles((axis[:, None] + ring).reshape(-1, 3), _ring_triangles(steps, sides))


def rectangle(extents: FloatArray, frame: FloatArray, steps: int) -> Triangles:
    """Return a rectangle with side lengths (2,) in the xy plane of a frame (4, 4), facing along z, as triangles."""
    fractions = np.linspace(-0.5, 0.5, steps + 1)
    x, y = np.meshgrid(fractions * extents[0], fractions * extents[1], indexing="ij")
    flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    a, b, c, d = corner, corner + steps + 1, corner + steps + 2, corner + 1
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Triangles(flat @ frame[:3, :3].T + frame[:3, 3], faces)


def _ring_triangles(rings: int, sides: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the triangles between consecutive closed rings of points."""
    row, column = (i.ravel() for i in np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij"))
    a, b = row * sides + column, row * sides + (column + 1) % sides
    c, d = a + sides, b + sides
    return np.concatenate([np.column_stack([a, c, d]), np.column_stack([a, d, b])]).astype(np.int64)


__all__ = ["CapsuleTip", "CylinderTip", "EllipsoidTip", "FlatTip", "HullTip", "SphereTip", "SymbolicTouch", "Tip"]
