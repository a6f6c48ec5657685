"""Numeric contact constraints of fingertips, by shape.

At the contact p the outward normal of the patch is the body's inward normal n, and the point of the patch with that
normal is p.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.rows import PROMISE, RowValue

ROUNDING = 1e-4  # allowed depth of a contact inside a capsule, as a share of the axis' length


@dataclass(frozen=True)
class Touching:
    """A fingertip with its contact.

    Parameters
    ----------
    name : str
        Name in the file: ``"on fingertip thumb_tip, finger 3"``.
    pose : (4, 4) array
        The link's frame in the body's.
    p, n : (3,) arrays
        Contact and inward normal, body frame.
    size : float
        The body's characteristic length, metres.
    error, turn : float
        Error bounds of a point and a unit direction of the link, by the digits in the file.
    """

    name: str
    pose: FloatArray
    p: FloatArray
    n: FloatArray
    size: float
    error: float
    turn: float

    def place(self, local: FloatArray) -> FloatArray:
        """Return a point of the link's frame in the body's frame."""
        return np.asarray(self.pose[:3, :3] @ local + self.pose[:3, 3])

    def length(self, what: str, value: float, lower: float = 0.0, upper: float = 0.0, slack: float = 0.0) -> RowValue:
        """Return a constraint on a length."""
        return RowValue(f"{self.name}, {what}", value, lower, upper, self.size, self.error + slack)

    def cosine(self, what: str, value: float, lower: float = 0.0, upper: float = 0.0) -> RowValue:
        """Return a constraint on the cosine of an angle."""
        return RowValue(f"{self.name}, {what}", value, lower, upper, error=self.turn)

    def equal(self, left: FloatArray, right: FloatArray, slack: FloatArray | None = None) -> Iterator[RowValue]:
        """Yield an equality constraint per coordinate."""
        extra = np.zeros(3) if slack is None else slack
        for i, axis in enumerate("xyz"):
            yield self.length(axis, float(left[i] - right[i]), slack=float(extra[i]))


def radius_of(tip: Json) -> float:
    """Return the radius of a round fingertip, metres; 0 for others."""
    return number("radius", tip["radius"], above=0.0) if tip["type"] in ("sphere", "cylinder", "capsule") else 0.0


def centre_of(tip: Json, touching: Touching) -> FloatArray:
    """Return the centre of a round fingertip's contact ball, body frame."""
    if tip["type"] == "sphere":
        return touching.place(array("offset", tip["offset"], (3,)))
    start, end = (touching.place(array(key, tip[key], (3,))) for key in ("start", "end"))
    wanted = touching.p - radius_of(tip) * touching.n
    share = float((wanted - start) @ (end - start)) / float((end - start) @ (end - start))
    return np.asarray(start + min(max(share, 0.0), 1.0) * (end - start))


def touching_rows(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints that put a contact onto a fingertip."""
    rows = ROWS.get(str(tip["type"]))
    if rows is None:
        raise NotMadeError(f"nothing recomputes a fingertip of type {tip['type']!r}")
    yield from rows(tip, touching)


def _sphere(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints ``c = p - r n``."""
    yield from touching.equal(centre_of(tip, touching), touching.p - radius_of(tip) * touching.n)


def _cylinder(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints ``a + s (b - a) = p - r n``, and n perpendicular to the axis.

    The coordinate s is not in the file: here it is that of the nearest point, so residuals along the axis are not seen.
    """
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    along = touching.pose[:3, :3] @ ((end - start) / np.linalg.norm(end - start))
    slack = 10.0 * PROMISE * touching.size * np.abs(along)
    yield from touching.equal(centre_of(tip, touching), touching.p - radius_of(tip) * touching.n, slack)
    yield touching.cosine("across", float(along @ touching.n))


def _capsule(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints ``a + s (b - a) = p - r n``, and limits on the tilt of n beyond the ends."""
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    length = float(np.linalg.norm(end - start))
    along, centre = touching.pose[:3, :3] @ ((end - start) / length), centre_of(tip, touching)
    slack = 10.0 * PROMISE * touching.size
    yield from touching.equal(centre, touching.p - radius_of(tip) * touching.n, slack * np.abs(along))
    share = float((centre - touching.place(start)) @ along) / length
    leans, error = float(along @ touching.n), touching.turn + (slack + touching.error) / length
    for what, value in (("over the end", (1.0 - share) * leans), ("over the start", -share * leans)):
        yield RowValue(f"{touching.name}, {what}", value, -np.inf, ROUNDING, error=error)


def _flat(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints of equal normals, and of the contact within the rectangle."""
    origin, axes = _frame(tip, touching)
    half = array("extents", tip["extents"], (2,)) / 2.0
    normal, local = axes.T @ touching.n, axes.T @ (touching.p - origin)
    yield touching.cosine("normal x", float(normal[0]))
    yield touching.cosine("normal y", float(normal[1]))
    yield touching.cosine("facing", float(normal[2]), 0.0, np.inf)
    yield touching.length("plane", float(local[2]))
    yield touching.length("extent x", float(local[0]), -half[0], half[0])
    yield touching.length("extent y", float(local[1]), -half[1], half[1])


def _ellipsoid(tip: Json, touching: Touching) -> Iterator[RowValue]:
    """Yield the constraints ``p = t + R A^2 m / |A m|`` with ``m = R^T n``, and m within the patch."""
    origin, axes = _frame(tip, touching)
    semi = array("semi_axes", tip["semi_axes"], (3,))
    normal = axes.T @ touching.n
    scaled = semi * normal
    yield from touching.equal(origin + axes @ (semi * scaled) / np.linalg.norm(scaled), touching.p)
    if tip["facing"] is not None:
        towards = float(array("facing", tip["facing"], (3,)) @ normal)
        yield touching.cosine("within the patch", towards, float(np.cos(number("angle", tip["angle"]))), np.inf)


def _frame(tip: Json, touching: Touching) -> tuple[FloatArray, FloatArray]:
    """Return origin and axes of a fingertip's frame, in the body's frame."""
    turned = Rotation.from_euler("xyz", array("rpy", tip["rpy"], (3,))).as_matrix()
    return touching.place(array("offset", tip["offset"], (3,))), np.asarray(touching.pose[:3, :3] @ turned)


ROWS: dict[str, Callable[[Json, Touching], Iterator[RowValue]]] = {
    "sphere": _sphere,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "flat": _flat,
    "ellipsoid": _ellipsoid,
}
"""The rows of each shape of fingertip; a new shape is one more entry."""
