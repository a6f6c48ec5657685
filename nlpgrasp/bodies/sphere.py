"""Sphere centred on the origin."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies import triangulation as curved
from nlpgrasp.bodies.base import TINY, CentredBody, Face
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, length_in_metres

ROWS = 15  # rows of triangles between a pole and the equator


@dataclass(frozen=True)
class Sphere(CentredBody):
    """A sphere about the origin; one face, ``surface``.

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "sphere"
    radius: float
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        object.__setattr__(self, "radius", length_in_metres("Sphere", "radius", self.radius, unit))

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        return np.full(3, self.radius)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face ``|p| = r``, scaled to metres."""
        return (Face("surface", lambda p: (ca.sumsqr(p) / self.radius - self.radius) / 2.0),)

    def distance(self, p: Expression) -> Expression:
        """Return ``|p| - r``, the exact signed distance."""
        return ca.sqrt(ca.sumsqr(p) + TINY) - self.radius

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3) on it, metres, and triangles (m, 3)."""
        points, faces = curved.triangulate_sphere(ROWS)
        return self.radius * points, faces

    def to_dict(self) -> Json:
        """Return the radius as JSON data."""
        return {"type": self.kind, "radius": self.radius}
