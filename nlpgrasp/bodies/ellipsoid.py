"""Axis-aligned ellipsoid."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies import triangulation as curved
from nlpgrasp.bodies.base import TINY, CentredBody, Face
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, array, in_metres, number

ROWS = 15  # rows of triangles between a pole and the equator


@dataclass(frozen=True)
class Ellipsoid(CentredBody):
    """An axis-aligned ellipsoid centred at the origin; one face, ``surface``.

    Parameters
    ----------
    semi_axes : (3,) array
        Along x, y, z, metres, each greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "ellipsoid"
    semi_axes: ArrayLike
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        values = in_metres("Ellipsoid.unit", array("Ellipsoid.semi_axes", self.semi_axes, (3,)), unit)
        object.__setattr__(self, "semi_axes", tuple(number("Ellipsoid.semi_axes", v, above=0.0) for v in values))

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        return np.asarray(self.semi_axes, dtype=float)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face ``sum (p_i / a_i)^2 = 1``, scaled to metres."""
        axes = ca.DM(np.asarray(self.semi_axes, dtype=float))
        scale = 0.5 * min(np.asarray(self.semi_axes, dtype=float))
        return (Face("surface", lambda p: scale * (ca.sumsqr(p / axes) - 1.0)),)

    def distance(self, p: Expression) -> Expression:
        """Return the distance ``(g - 1) / |grad g|`` of a CasADi point, with ``g = |p / a|``, a lower bound outside."""
        axes = ca.DM(np.asarray(self.semi_axes, dtype=float))
        gauge = ca.sqrt(ca.sumsqr(p / axes) + TINY)
        return (gauge - 1.0) * gauge / ca.sqrt(ca.sumsqr(p / axes**2) + TINY)

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3) on it, metres, and triangles (m, 3)."""
        points, faces = curved.triangulate_sphere(ROWS)
        return self.half_size * points, faces

    def to_dict(self) -> Json:
        """Return the semi-axes as JSON data."""
        return {"type": self.kind, "semi_axes": list(np.asarray(self.semi_axes, dtype=float))}
