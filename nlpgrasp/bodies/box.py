"""Axis-aligned box."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies.base import CentredBody, Face, intersection
from nlpgrasp.bodies.triangulation import extrude
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, array, in_metres, number


@dataclass(frozen=True)
class Box(CentredBody):
    """A box centred at the origin; faces ``+x``, ``-x``, ``+y``, ``-y``, ``+z``, ``-z``.

    Parameters
    ----------
    extents : (3,) array
        Full lengths along x, y, z, metres, each greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "box"
    extents: ArrayLike
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        values = in_metres("Box.unit", array("Box.extents", self.extents, (3,)), unit)
        object.__setattr__(self, "extents", tuple(number("Box.extents", v, above=0.0) for v in values))

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        return np.asarray(self.extents, dtype=float) / 2.0

    def make_faces(self) -> tuple[Face, ...]:
        """Return the six faces."""
        half = np.asarray(self.extents, dtype=float) / 2.0
        return tuple(_side(axis, sign, half) for axis in range(3) for sign in (1.0, -1.0))

    def distance(self, p: Expression) -> Expression:
        """Return the exact signed distance of a CasADi point, metres, negative inside."""
        half = np.asarray(self.extents, dtype=float) / 2.0
        return intersection([ca.fabs(p[i]) - half[i] for i in range(3)])

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3), metres, and triangles (m, 3)."""
        x, y, z = self.half_size
        return extrude(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), -z, z)

    def to_dict(self) -> Json:
        """Return the extents as JSON data."""
        return {"type": self.kind, "extents": list(np.asarray(self.extents, dtype=float))}


def _side(axis: int, sign: float, half: FloatArray) -> Face:
    """Return the face of a box perpendicular to an axis, on the positive or negative side."""
    transverse = [i for i in range(3) if i != axis]

    def extent(p: Expression) -> list[Expression]:
        return [s * p[i] - half[i] for i in transverse for s in (1.0, -1.0)]

    name, room = ("+" if sign > 0 else "-") + "xyz"[axis], float(min(half[i] for i in transverse))
    return Face(name, lambda p: sign * p[axis] - half[axis], extent, room=room)
