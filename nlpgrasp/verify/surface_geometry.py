"""Triangle surfaces: distances from triangles and from sharp edges, in numpy alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.meshes.sharp_edges import SHARP
from nlpgrasp.common.validation import FloatArray, IntArray

SMALLEST = 1e-300  # smallest divisor

Distance = Callable[[FloatArray], float]
"""Function of a point (space,) of a face to its distance from the face's sharp edges, metres; infinite without any."""


@dataclass(frozen=True)
class TriangleSurface:
    """Surface of triangles, counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : (n, 3) array
        Metres.
    faces : (m, 3) array of int
    """

    vertices: FloatArray
    faces: IntArray

    @cached_property
    def corners(self) -> FloatArray:
        """Corners of the triangles, (m, 3, 3)."""
        return self.vertices[self.faces]

    @cached_property
    def normals(self) -> FloatArray:
        """Outward unit normals of the triangles, (m, 3)."""
        a, b, c = (self.corners[:, i] for i in range(3))
        normal = np.cross(b - a, c - a)
        return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), SMALLEST)[:, None])

    def nearby_triangles(self, point: FloatArray, reach: float) -> tuple[IntArray, FloatArray]:
        """Return the triangles that may be within ``reach`` of the nearest one, and their distances from a point (3,).

        Bounding balls about the triangles' centres rule out nearly all of them.
        """
        centre, radius = self._balls
        distances = np.linalg.norm(centre - point, axis=1)
        nearby = np.flatnonzero(distances - radius <= np.min(distances) + reach)
        return nearby, triangle_distances(point, self.corners[nearby])

    def distance(self, point: FloatArray) -> float:
        """Return the distance of a point (3,) from the nearest triangle, metres."""
        return float(np.min(self.nearby_triangles(point, 0.0)[1]))

    def is_inside(self, point: FloatArray) -> bool:
        """Return whether the surface encloses a point (3,).

        By solid angles (Van Oosterom and Strackee 1983).
        """
        a, b, c = ((self.corners[:, i] - point) for i in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = np.einsum("ij,ij->i", a, b), np.einsum("ij,ij->i", b, c), np.einsum("ij,ij->i", c, a)
        angles = np.arctan2(volume, la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb)
        return bool(np.sum(angles) > np.pi)  # each is half a solid angle: together 2 pi inside, 0 outside

    @cached_property
    def _balls(self) -> tuple[FloatArray, FloatArray]:
        """Centres (m, 3) and radii (m,) of balls around the triangles, metres."""
        centre = self.corners.mean(axis=1)
        return centre, np.max(np.linalg.norm(self.corners - centre[:, None], axis=2), axis=1)


def triangle_distances(point: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the distances of a point (3,) from triangles (m, 3, 3)."""
    a, b, c = (corners[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), SMALLEST)[:, None]
    inside = np.ones(len(corners), dtype=bool)
    result = np.full(len(corners), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along, offset = end - start, point - start
        inside &= np.einsum("ij,ij->i", np.cross(along, offset), normal) >= 0.0
        fractions = np.einsum("ij,ij->i", offset, along) / np.maximum(np.einsum("ij,ij->i", along, along), SMALLEST)
        differences = offset - np.clip(fractions, 0.0, 1.0)[:, None] * along
        result = np.minimum(result, np.linalg.norm(differences, axis=1))
    plane_distances = np.abs(np.einsum("ij,ij->i", point - a, normal))
    return np.where(inside & np.any(normal, axis=1), plane_distances, result)


def from_corners(v: FloatArray, i: int) -> Distance:
    """Return the distance from the sharp ends of a polygon's edge, as a function of a point.

    An end is sharp if the polygon turns there by more than 30 degrees.
    """
    previous, start, end, following = (v[(i + j) % len(v)] for j in (-1, 0, 1, 2))
    sharp_ends = [
        corner
        for a, corner, b in ((previous, start, end), (start, end, following))
        if _cosine(corner - a, b - corner) < np.cos(SHARP)
    ]
    return lambda p: min((float(np.linalg.norm(p[:2] - corner)) for corner in sharp_ends), default=np.inf)


def _cosine(a: FloatArray, b: FloatArray) -> float:
    """Return the cosine of the angle between two vectors."""
    return float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b))


def from_segments(segments: FloatArray) -> Distance:
    """Return the distance from the nearest of several segments (m, 2, 3), as a function of a point."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    lengths = np.maximum(np.sum(along**2, axis=1), SMALLEST)

    def distance(p: FloatArray) -> float:
        t = np.clip(np.sum((p - start) * along, axis=1) / lengths, 0.0, 1.0)
        return float(np.min(np.linalg.norm(p - start - t[:, None] * along, axis=1), initial=np.inf))

    return distance
