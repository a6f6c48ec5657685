"""Planar body bounded by a simple polygon, and polygon geometry."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies.base import TINY, Body, Face, exterior_angles
from nlpgrasp.bodies.triangulation import PLATE, extrude
from nlpgrasp.common.meshes.sharp_edges import SHARP
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray, array, in_metres
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Polygon(Body):
    """A planar body bounded by straight edges; faces ``edge0``, ``edge1``, ... in the order of the vertices.

    Edge i runs from vertex i to vertex i + 1. The polygon may be non-convex; its edges must not cross.

    Parameters
    ----------
    vertices : (m, 2) array
        Metres, in either sense of rotation (stored counter-clockwise, starting at the first).
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the lengths given; the body's own are metres.
    """

    kind: ClassVar[str] = "polygon"
    vertices: ArrayLike
    unit: InitVar[str] = field(default="m", kw_only=True)

    def __post_init__(self, unit: str) -> None:
        object.__setattr__(self, "vertices", simple_polygon("Polygon.vertices", self.vertices, unit))

    @property
    def corners(self) -> FloatArray:
        """Vertices of the polygon, (m, 2), counter-clockwise, metres."""
        return np.asarray(self.vertices, dtype=float)

    @property
    def space(self) -> int:
        """Dimension of the space: 2, the plane."""
        return 2

    @property
    def bounds(self) -> FloatArray:
        """Bounding box of the vertices, (2, 2): lower corner, upper corner, metres."""
        return np.stack([self.corners.min(axis=0), self.corners.max(axis=0)])

    @property
    def centroid(self) -> FloatArray:
        """Centre of the polygon's area, (2,), metres."""
        return polygon_centroid(self.corners)

    @property
    def cramped(self) -> bool:
        """Whether the polygon has a reflex vertex."""
        return bool(np.any(exterior_angles(self.corners) < -1e-9))

    def make_faces(self) -> tuple[Face, ...]:
        """Return one face for each edge."""
        return tuple(edge_face(f"edge{i}", self.corners, i) for i in range(len(self.corners)))

    def distance(self, p: Expression) -> Expression:
        """Return the exact signed distance of a CasADi point, metres, negative inside."""
        return polygon_distance(self.corners, p)

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return a triangulation of the polygon as a thin plate: vertices (n, 3), metres, and triangles (m, 3)."""
        half = PLATE / 2.0 * self.size
        return extrude(self.corners, -half, half)

    def to_dict(self) -> Json:
        """Return the vertices as JSON data."""
        return {"type": self.kind, "vertices": self.corners.tolist()}


def simple_polygon(field: str, vertices: ArrayLike, unit: str = "m") -> tuple[tuple[float, float], ...]:
    """Return the vertices counter-clockwise, metres; raise for fewer than 3, zero area or crossing edges."""
    v = in_metres(f"{field.split('.')[0]}.unit", array(field, vertices, (None, 2)), unit)
    if len(v) < 3:
        raise InputError(field, f"{len(v)} vertices", "at least 3 vertices")
    successors = np.roll(v, -1, axis=0)
    area = _area(v - v[0])
    extent = float(np.max(np.ptp(v, axis=0)))
    if abs(area) <= 1e-12 * extent**2:
        raise InputError(field, f"area {area:.3g}", "a polygon of non-zero area")
    if np.min(np.linalg.norm(successors - v, axis=1)) <= 1e-9 * extent:
        raise InputError(field, "two equal neighbouring vertices", "distinct vertices")
    m = len(v)
    for i in range(m):
        for j in range(i + 2, m):
            if (i, j) != (0, m - 1) and _segments_touch(v[i], successors[i], v[j], successors[j], 1e-9 * extent):
                raise InputError(field, f"edges {i} and {j} that meet", "a simple polygon")
        backward, forward = v[i] - successors[i], np.roll(v, -2, axis=0)[i] - successors[i]
        if (
            backward @ forward > 0.0
            and abs(backward[0] * forward[1] - backward[1] * forward[0]) <= 1e-9 * backward @ forward
        ):
            raise InputError(field, f"edge {(i + 1) % m} that runs back over edge {i}", "a simple polygon")
    if area < 0.0:
        v = np.concatenate([v[:1], v[:0:-1]])
    return tuple((float(x), float(y)) for x, y in v)


def polygon_centroid(v: FloatArray) -> FloatArray:
    """Return the centroid (2,) of a polygon's area."""
    local = v - v[0]  # far from the origin, products of coordinates would lose the digits that matter
    successors = np.roll(local, -1, axis=0)
    cross = local[:, 0] * successors[:, 1] - local[:, 1] * successors[:, 0]
    return np.asarray(v[0] + ((local + successors) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))


def _area(v: FloatArray) -> float:
    """Return the signed area of a polygon (m, 2), positive if counter-clockwise."""
    successors = np.roll(v, -1, axis=0)
    return 0.5 * float(np.sum(v[:, 0] * successors[:, 1] - v[:, 1] * successors[:, 0]))


def polygon_distance(v: FloatArray, p: Expression) -> Expression:
    """Return the signed distance of a CasADi point to a polygon in the xy plane, negative inside."""
    nearest: Expression = np.inf
    sign: Expression = 1.0
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        edge, x, y = b - a, p[0] - a[0], p[1] - a[1]
        t = ca.fmax(ca.fmin((x * edge[0] + y * edge[1]) / float(edge @ edge), 1.0), 0.0)
        nearest = ca.fmin(nearest, (x - t * edge[0]) ** 2 + (y - t * edge[1]) ** 2)
        if edge[1] != 0.0:  # a ray along +x crosses the edge: one side becomes the other
            is_level = (p[1] >= min(a[1], b[1])) * (p[1] < max(a[1], b[1]))
            is_crossed = is_level * (x < y * (edge[0] / edge[1]))
            sign = sign * (1.0 - 2.0 * is_crossed)
    return sign * ca.sqrt(nearest + TINY)


def edge_face(name: str, v: FloatArray, i: int, height: float | None = None) -> Face:
    """Return the face of a polygon's edge: a segment, or a rectangle of the given height about z = 0."""
    start, end = v[i], v[(i + 1) % len(v)]
    length = float(np.linalg.norm(end - start))
    direction = (end - start) / length
    outward = np.array([direction[1], -direction[0]])

    def surface(p: Expression) -> Expression:
        return outward[0] * (p[0] - start[0]) + outward[1] * (p[1] - start[1])

    def extent(p: Expression) -> list[Expression]:
        position = direction[0] * (p[0] - start[0]) + direction[1] * (p[1] - start[1])
        limits = [-position, position - length]
        return limits if height is None else [*limits, p[2] - height / 2.0, -p[2] - height / 2.0]

    sharp = [bool(turn > SHARP) for turn in np.abs(exterior_angles(v))[[i, (i + 1) % len(v)]]]
    room = length / sum(sharp) if any(sharp) else np.inf
    if height is not None:
        sharp, room = [*sharp, True, True], min(room, height / 2.0)
    return Face(name, surface, extent, sharp, room=room)


def polygon_inradius(v: FloatArray) -> float:
    """Return the radius, metres, of the largest circle in a convex polygon (m, 2), counter-clockwise."""
    from scipy.optimize import linprog

    directions = np.roll(v, -1, axis=0) - v
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    outward = np.column_stack([directions[:, 1], -directions[:, 0]])
    middle = v.mean(axis=0)
    sides = np.sum(outward * (v - middle), axis=1)
    solution = linprog([0.0, 0.0, -1.0], np.column_stack([outward, np.ones(len(v))]), sides, bounds=[(None, None)] * 3)
    return float(-np.asarray(solution.fun))


def _segments_touch(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, tolerance: float) -> bool:
    """Return whether the segments ab and cd are within a tolerance of each other."""

    def side(o: FloatArray, p: FloatArray, q: FloatArray) -> float:
        return float((p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0]))

    def distance(p: FloatArray, o: FloatArray, e: FloatArray) -> float:
        position = np.clip((p - o) @ (e - o) / ((e - o) @ (e - o)), 0.0, 1.0)
        return float(np.linalg.norm(p - o - position * (e - o)))

    if side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0:
        return True
    return min(distance(a, c, d), distance(b, c, d), distance(c, a, b), distance(d, a, b)) <= tolerance
