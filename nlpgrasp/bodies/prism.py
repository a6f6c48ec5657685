"""Prism: a convex polygon extruded along z."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies.base import Body, Face, intersection
from nlpgrasp.bodies.polygon import edge_face, polygon_centroid, polygon_distance, polygon_inradius, simple_polygon
from nlpgrasp.bodies.triangulation import extrude
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, length_in_metres
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Prism(Body):
    """A convex polygon extruded along z, centred at z = 0; faces ``side0``, ..., ``top`` (+z), ``bottom``.

    Parameters
    ----------
    polygon : (m, 2) array
        Vertices of a convex polygon, metres.
    height : float
        Metres, greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "prism"
    polygon: ArrayLike
    height: float
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        object.__setattr__(self, "polygon", simple_polygon("Prism.polygon", self.polygon, unit))
        object.__setattr__(self, "height", length_in_metres("Prism", "height", self.height, unit))
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        successors = np.roll(edges, -1, axis=0)
        if np.any(
            edges[:, 0] * successors[:, 1] - edges[:, 1] * successors[:, 0]
            < -1e-9 * np.max(np.ptp(self.corners, axis=0)) ** 2
        ):
            raise InputError("Prism.polygon", "a non-convex polygon", "a convex polygon")

    @property
    def corners(self) -> FloatArray:
        """Vertices of the polygon, (m, 2), counter-clockwise, metres."""
        return np.asarray(self.polygon, dtype=float)

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, 3): lower corner, upper corner, metres."""
        half = self.height / 2.0
        lower, upper = self.corners.min(axis=0), self.corners.max(axis=0)
        return np.stack([np.append(lower, -half), np.append(upper, half)])

    @property
    def centroid(self) -> FloatArray:
        """Centre of the prism's volume, (3,), metres."""
        return np.append(polygon_centroid(self.corners), 0.0)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the sides, the top and the bottom."""
        half = self.height / 2.0
        count = len(self.corners)
        sides = [edge_face(f"side{i}", self.corners, i, self.height) for i in range(count)]

        def cross_section(p: Expression) -> list[Expression]:
            return [side.surface(p) for side in sides]

        room = polygon_inradius(self.corners)
        top = Face("top", lambda p: p[2] - half, cross_section, room=room)
        return (*sides, top, Face("bottom", lambda p: -p[2] - half, cross_section, room=room))

    def distance(self, p: Expression) -> Expression:
        """Return the exact signed distance of a CasADi point, metres, negative inside."""
        return intersection([polygon_distance(self.corners, p), ca.fabs(p[2]) - self.height / 2.0])

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3), metres, and triangles (m, 3)."""
        return extrude(self.corners, -self.height / 2.0, self.height / 2.0)

    def to_dict(self) -> Json:
        """Return polygon and height as JSON data."""
        return {"type": self.kind, "polygon": self.corners.tolist(), "height": self.height}
