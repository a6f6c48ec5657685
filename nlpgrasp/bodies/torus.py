"""Torus about the z axis."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies import triangulation as curved
from nlpgrasp.bodies.base import TINY, CentredBody, Face
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, length_in_metres
from nlpgrasp.errors import InputError

AROUND, ACROSS = 48, 20  # points of the triangulation about the axis and about the tube


@dataclass(frozen=True)
class Torus(CentredBody):
    """A torus about the z axis, centred at the origin; one face, ``surface``.

    Parameters
    ----------
    major_radius : float
        From the axis to the centre of the tube, metres; greater than the minor radius.
    minor_radius : float
        Of the tube, metres, greater than zero.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "torus"
    major_radius: float
    minor_radius: float
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        for name in ("major_radius", "minor_radius"):
            object.__setattr__(self, name, length_in_metres("Torus", name, getattr(self, name), unit))
        if self.minor_radius >= self.major_radius:
            raise InputError("Torus.minor_radius", self.minor_radius, f"less than the major radius {self.major_radius}")

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        outer = self.major_radius + self.minor_radius
        return np.array([outer, outer, self.minor_radius])

    @property
    def cramped(self) -> bool:
        """Always true: a torus has a hole."""
        return True

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face ``(d^2 / r - r) / 2 = 0`` with the distance d from the tube's centre line."""
        major, minor = self.major_radius, self.minor_radius

        def surface(p: Expression) -> Expression:
            ring = ca.sqrt(p[0] ** 2 + p[1] ** 2 + 1e-24) - major
            return ((ring**2 + p[2] ** 2) / minor - minor) / 2.0

        return (Face("surface", surface),)

    def distance(self, p: Expression) -> Expression:
        """Return the exact signed distance of a CasADi point, metres, negative inside."""
        ring = ca.sqrt(p[0] ** 2 + p[1] ** 2 + TINY) - self.major_radius
        return ca.sqrt(ring**2 + p[2] ** 2 + TINY) - self.minor_radius

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3) on it, metres, and triangles (m, 3)."""
        return curved.triangulate_torus(self.major_radius, self.minor_radius, AROUND, ACROSS)

    def to_dict(self) -> Json:
        """Return both radii as JSON data."""
        return {"type": self.kind, "major_radius": self.major_radius, "minor_radius": self.minor_radius}
