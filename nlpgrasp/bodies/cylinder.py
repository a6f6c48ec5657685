"""Circular cylinder about the z axis."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies.base import TINY, CentredBody, Face, intersection
from nlpgrasp.bodies.triangulation import circle_points, extrude
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, length_in_metres

ROUND = 96  # sides of the prism that approximates it as triangles


@dataclass(frozen=True)
class Cylinder(CentredBody):
    """A solid cylinder about the z axis, centred at the origin; faces ``side``, ``top`` (+z), ``bottom``.

    Parameters
    ----------
    radius, height : float
        Metres, greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "cylinder"
    radius: float
    height: float
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        for name in ("radius", "height"):
            object.__setattr__(self, name, length_in_metres("Cylinder", name, getattr(self, name), unit))

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        return np.array([self.radius, self.radius, self.height / 2.0])

    def make_faces(self) -> tuple[Face, ...]:
        """Return the side, the top and the bottom."""
        half, radius = self.height / 2.0, self.radius

        def lateral_surface(p: Expression) -> Expression:
            return ((p[0] ** 2 + p[1] ** 2) / radius - radius) / 2.0

        def disc(p: Expression) -> list[Expression]:
            return [ca.sqrt(p[0] ** 2 + p[1] ** 2 + TINY) - radius]

        return (
            Face("side", lateral_surface, lambda p: [p[2] - half, -p[2] - half], room=half),
            Face("top", lambda p: p[2] - half, disc, room=radius),
            Face("bottom", lambda p: -p[2] - half, disc, room=radius),
        )

    def distance(self, p: Expression) -> Expression:
        """Return the exact signed distance of a CasADi point, metres, negative inside."""
        radial = ca.sqrt(p[0] ** 2 + p[1] ** 2 + TINY) - self.radius
        return intersection([radial, ca.fabs(p[2]) - self.height / 2.0])

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of an inscribed prism: vertices (n, 3), metres, and triangles (m, 3)."""
        return extrude(circle_points(self.radius, ROUND), -self.height / 2.0, self.height / 2.0)

    def to_dict(self) -> Json:
        """Return radius and height as JSON data."""
        return {"type": self.kind, "radius": self.radius, "height": self.height}
