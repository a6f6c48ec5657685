"""Sphere body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies.base import TINY, Body, Face
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, number


@dataclass(frozen=True)
class Sphere(Body):
    """A sphere about the origin; one face, ``surface``.

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    """

    kind: ClassVar[str] = "sphere"
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number("Sphere.radius", self.radius, above=0.0))

    @property
    def space(self) -> int:
        """3."""
        return 3

    @property
    def bounds(self) -> FloatArray:
        """Cube of the radius."""
        return np.array([[-self.radius] * 3, [self.radius] * 3])

    @property
    def centroid(self) -> FloatArray:
        """The origin."""
        return np.zeros(3)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face."""
        return (Face("surface", lambda p: (ca.sumsqr(p) / self.radius - self.radius) / 2.0),)

    def distance(self, p: Expression) -> Expression:
        """Return ``|p| - r``."""
        return ca.sqrt(ca.sumsqr(p) + TINY) - self.radius

    def to_dict(self) -> Json:
        """Return the radius."""
        return {"type": self.kind, "radius": self.radius}
