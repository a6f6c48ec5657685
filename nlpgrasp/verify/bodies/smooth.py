"""Bodies with one smooth face: sphere, ellipsoid, superquadric and torus.

Each is the zero set of a function h with gradient g: ``|h| / |g|`` is the distance to it, exactly for sphere and torus,
to first order near the surface for the others, and ``g / |g|`` is the outward normal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.placement import Fit
from nlpgrasp.verify.sources import Sources

Field = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
SMALLEST = 1e-300
ROUNDED = 1e-8  # superquadrics: width of the smoothing of powers below 2 near the planes of symmetry


@dataclass(frozen=True)
class SmoothSurface:
    """Surface of a body with the one face ``surface``.

    Parameters
    ----------
    corner : (3,) array
        Upper corner of the bounding box; the lower one is opposite.
    field : callable
        Points (m, 3) to signed distances (m,) and outward gradients (m, 3).
    """

    corner: FloatArray
    field: Field
    rough: float = 0.0
    tight: bool = True

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, 3)."""
        return np.stack([-self.corner, self.corner])

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return distance and normal deviation of a contact."""
        if face != "surface":
            raise KeyError(face)
        distance, gradient = self.field(point[None])
        outward = gradient[0] / max(float(np.linalg.norm(gradient[0])), SMALLEST)
        return Fit(abs(float(distance[0])), float(np.linalg.norm(normal + outward)))

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a point (space,) of a face from its sharp edges, metres; infinite without any."""
        return np.inf

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3)."""
        return self.field(points)[0]


def sphere(data: Json, sources: Sources) -> SmoothSurface:
    """Return a sphere with the distance ``|p| - r``."""
    radius = number("radius", data["radius"], above=0.0)
    return SmoothSurface(np.full(3, radius), lambda p: (np.linalg.norm(p, axis=1) - radius, p))


def ellipsoid(data: Json, sources: Sources) -> SmoothSurface:
    """Return an ellipsoid with ``(g - 1) / |grad g|``, gauge ``g = |p / a|``: a lower bound on the distance outside."""
    axes = positive("semi_axes", data["semi_axes"], 3)

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        gauge = np.linalg.norm(p / axes, axis=1)
        gradient = p / axes**2
        return (gauge - 1.0) * gauge / np.maximum(np.linalg.norm(gradient, axis=1), SMALLEST), gradient

    return SmoothSurface(axes, field)


def torus(data: Json, sources: Sources) -> SmoothSurface:
    """Return a torus: the distance from the tube's centre line less the minor radius."""
    major, minor = (number(key, data[key], above=0.0) for key in ("major_radius", "minor_radius"))
    if not minor < major:
        raise InputError("minor_radius", minor, f"less than the major radius, {major:g}")

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        around = np.linalg.norm(p[:, :2], axis=1)
        ring = around - major
        flat = p[:, :2] * (ring / np.maximum(around, SMALLEST))[:, None]
        return np.hypot(ring, p[:, 2]) - minor, np.column_stack([flat, p[:, 2]])

    return SmoothSurface(np.array([major + minor, major + minor, minor]), field)


def superquadric(data: Json, sources: Sources) -> SmoothSurface:
    """Return ``(F - 1) / |grad F|`` with F of degree 1, ``((x^(2/e2) + y^(2/e2))^(e2/e1) + z^(2/e1))^(e1/2)``."""
    axes, (e1, e2) = positive("semi_axes", data["semi_axes"], 3), positive("exponents", data["exponents"], 2)

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        share = p / axes
        x, y, z = (np.sqrt(share[:, i] ** 2 + ROUNDED**2) for i in range(3))
        flat = x ** (2.0 / e2) + y ** (2.0 / e2)
        inner = flat ** (e2 / e1) + z ** (2.0 / e1)
        outer = inner ** (e1 / 2.0 - 1.0)
        around = outer * flat ** (e2 / e1 - 1.0)
        slopes = (around * x ** (2.0 / e2 - 1.0), around * y ** (2.0 / e2 - 1.0), outer * z ** (2.0 / e1 - 1.0))
        gradient = np.column_stack([s / v for s, v in zip(slopes, (x, y, z), strict=True)]) * share / axes
        return (inner ** (e1 / 2.0) - 1.0) / np.maximum(np.linalg.norm(gradient, axis=1), SMALLEST), gradient

    return SmoothSurface(axes, field)


def positive(field: str, value: object, count: int) -> FloatArray:
    """Return validated lengths (count,) above zero."""
    lengths = array(field, value, (count,))
    if not np.all(lengths > 0.0):
        raise InputError(field, value, "numbers above zero")
    return lengths
