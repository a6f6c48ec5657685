"""Superquadric: rounded box, ellipsoid or octahedral shape."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies import triangulation as curved
from nlpgrasp.bodies.base import CentredBody, Face
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, array, in_metres, number
from nlpgrasp.errors import InputError

QUARTER = 11  # parts of a quarter of each curve in the triangulation


@dataclass(frozen=True)
class Superquadric(CentredBody):
    """Superquadric ``(|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1``; one face, ``surface``.

    Exponents of 1 give an ellipsoid, small ones a rounded box, ``e1`` small with ``e2 = 1`` a rounded can
    (Barr, "Superquadrics and angle-preserving transformations", 1981, doi:10.1109/MCG.1981.1673799).

    Parameters
    ----------
    semi_axes : (3,) array
        Metres, each greater than zero.
    exponents : (2,) array
        ``(e1, e2)``, each in [0.2, 1.9]: outside it the normals are too ill-conditioned to be of use.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the semi-axes given; the body's own are metres.
    """

    kind: ClassVar[str] = "superquadric"
    semi_axes: ArrayLike
    exponents: ArrayLike = (0.5, 0.5)
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        axes = in_metres("Superquadric.unit", array("Superquadric.semi_axes", self.semi_axes, (3,)), unit)
        object.__setattr__(self, "semi_axes", tuple(number("Superquadric.semi_axes", v, above=0.0) for v in axes))
        e = array("Superquadric.exponents", self.exponents, (2,))
        if np.any(e < 0.2) or np.any(e > 1.9):
            raise InputError("Superquadric.exponents", self.exponents, "two numbers from 0.2 to 1.9")
        object.__setattr__(self, "exponents", (float(e[0]), float(e[1])))

    @property
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""
        return np.asarray(self.semi_axes, dtype=float)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face ``g(p) = 1``, scaled to metres, with g homogeneous of degree 1."""
        axes = np.asarray(self.semi_axes, dtype=float)
        e1, e2 = np.asarray(self.exponents, dtype=float)
        tiny = 1e-8  # rounds the planes of symmetry, where powers below 2 have no second derivative

        def surface(p: Expression) -> Expression:
            x, y, z = (ca.sqrt((p[i] / axes[i]) ** 2 + tiny**2) for i in range(3))
            flat = (x ** (2.0 / e2) + y ** (2.0 / e2)) ** (e2 / e1)
            return axes.min() * ((flat + z ** (2.0 / e1)) ** (e1 / 2.0) - 1.0)

        return (Face("surface", surface),)

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the surface: vertices (n, 3) on it, metres, and triangles (m, 3)."""
        return curved.triangulate_superquadric(self.half_size, np.asarray(self.exponents, dtype=float), QUARTER)

    def to_dict(self) -> Json:
        """Return semi-axes and exponents as JSON data."""
        exponents = list(np.asarray(self.exponents, dtype=float))
        return {
            "type": self.kind,
            "semi_axes": list(np.asarray(self.semi_axes, dtype=float)),
            "exponents": exponents,
        }
