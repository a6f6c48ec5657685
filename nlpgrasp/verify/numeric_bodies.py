"""Numeric bodies from JSON data: surfaces, normals and signed distances in closed form.

A body with one smooth face (``SmoothSurface``) is the zero set of a function h with gradient g: ``|h| / |g|`` is the
distance to it, exactly for sphere and torus, to first order near the surface for the others, and ``g / |g|`` is the
outward normal. A body of several faces (``FacedSurface``) has exact distances. Of an implicit body (``UnknownSurface``)
the file holds the bounding box alone. Meshes are in ``mesh_body``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import Fit
from nlpgrasp.verify.surface_geometry import SMALLEST, Distance, from_corners

SMOOTHING = 1e-8  # superquadrics: width of the smoothing of powers below 2 near the planes of symmetry

Field = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function of points (m, 3) to signed distances (m,) and outward gradients (m, 3)."""
Piece = Callable[[FloatArray], tuple[float, FloatArray, float]]
"""Function of a point to its distance from a face's plane or cylinder, outward normal, and excess past the edges."""


@dataclass(frozen=True)
class SmoothSurface:
    """Smooth surface of a body, with the single face ``surface``.

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

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, 3)."""
        return np.stack([-self.corner, self.corner])

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the distance of a contact from the surface, and the deviation of its normal."""
        if face != "surface":
            raise KeyError(face)
        distance, gradient = self.field(point[None])
        outward = gradient[0] / max(float(np.linalg.norm(gradient[0])), SMALLEST)
        return Fit(abs(float(distance[0])), float(np.linalg.norm(normal + outward)))

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return infinity, as a smooth surface has no sharp edges."""
        return np.inf

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points (m, 3) from the surface."""
        return self.field(points)[0]


def sphere(data: Json, sources: SourceFolders) -> SmoothSurface:
    """Return a sphere with the exact distance ``|p| - r``."""
    radius = number("radius", data["radius"], above=0.0)
    return SmoothSurface(np.full(3, radius), lambda p: (np.linalg.norm(p, axis=1) - radius, p))


def ellipsoid(data: Json, sources: SourceFolders) -> SmoothSurface:
    """Return an ellipsoid, with an approximate distance that is a lower bound outside.

    The distance is ``(g - 1) / |grad g|`` with the gauge ``g = |p / a|``.
    """
    axes = positive("semi_axes", data["semi_axes"], 3)

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        gauge = np.linalg.norm(p / axes, axis=1)
        gradient = p / axes**2  # g grad g
        distance = (gauge - 1.0) * gauge / np.maximum(np.linalg.norm(gradient, axis=1), SMALLEST)
        return np.where(gauge > SMALLEST, distance, -np.min(axes)), gradient

    return SmoothSurface(axes, field)


def torus(data: Json, sources: SourceFolders) -> SmoothSurface:
    """Return a torus, with its exact distance.

    The distance is that from the tube's centre line less the minor radius.
    """
    major, minor = (number(key, data[key], above=0.0) for key in ("major_radius", "minor_radius"))
    if not minor < major:
        raise InputError("minor_radius", minor, f"less than the major radius, {major:g}")

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances, and the vectors from the centre line: along the gradients, but of any length."""
        radius = np.linalg.norm(p[:, :2], axis=1)
        radial = radius - major
        radial_vectors = p[:, :2] * (radial / np.maximum(radius, SMALLEST))[:, None]
        return np.hypot(radial, p[:, 2]) - minor, np.column_stack([radial_vectors, p[:, 2]])

    return SmoothSurface(np.array([major + minor, major + minor, minor]), field)


def superquadric(data: Json, sources: SourceFolders) -> SmoothSurface:
    """Return a superquadric, with an approximate distance.

    It is ``(F - 1) / |grad F|`` with F of degree 1, ``((x^(2/e2) + y^(2/e2))^(e2/e1) + z^(2/e1))^(e1/2)``.
    """
    axes, (e1, e2) = positive("semi_axes", data["semi_axes"], 3), positive("exponents", data["exponents"], 2)

    def field(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        scaled = p / axes
        x, y, z = (np.sqrt(scaled[:, i] ** 2 + SMOOTHING**2) for i in range(3))
        planar = x ** (2.0 / e2) + y ** (2.0 / e2)
        inner = planar ** (e2 / e1) + z ** (2.0 / e1)
        outer = inner ** (e1 / 2.0 - 1.0)
        planar_slope = outer * planar ** (e2 / e1 - 1.0)
        slopes = (
            planar_slope * x ** (2.0 / e2 - 1.0),
            planar_slope * y ** (2.0 / e2 - 1.0),
            outer * z ** (2.0 / e1 - 1.0),
        )
        gradient = np.column_stack([s / v for s, v in zip(slopes, (x, y, z), strict=True)]) * scaled / axes
        return (inner ** (e1 / 2.0) - 1.0) / np.maximum(np.linalg.norm(gradient, axis=1), SMALLEST), gradient

    return SmoothSurface(axes, field)


def positive(field: str, value: object, count: int) -> FloatArray:
    """Return lengths (count,), validated to be above zero."""
    lengths = array(field, value, (count,))
    if not np.all(lengths > 0.0):
        raise InputError(field, value, "numbers above zero")
    return lengths


@dataclass(frozen=True)
class FacedSurface:
    """Surface of a body with several faces.

    Parameters
    ----------
    bounds : (2, space) array
    pieces : mapping
        Piece of each face.
    field : callable
        Points (m, space) to signed distances (m,).
    edges : mapping
        Distance from the sharp edges of each face.
    """

    bounds: FloatArray
    pieces: Mapping[str, Piece]
    field: Callable[[FloatArray], FloatArray]
    edges: Mapping[str, Distance]
    rough: float = 0.0

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the distance of a contact from its face, and the deviation of its normal."""
        distance, outward, overshoot = self.pieces[face](point)
        return Fit(float(np.hypot(distance, max(overshoot, 0.0))), float(np.linalg.norm(normal + outward)))

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a face's point (space,) from the face's sharp edges, metres; infinite without any."""
        return self.edges[face](point)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points (m, space) from the surface."""
        return self.field(points)


def box(data: Json, sources: SourceFolders) -> FacedSurface:
    """Return a box with the faces ``+x``, ``-x``, ..."""
    half = positive("extents", data["extents"], 3) / 2.0
    pieces = {
        ("+" if sign > 0.0 else "-") + "xyz"[axis]: _side_of_box(axis, sign, half)
        for axis in range(3)
        for sign in (1.0, -1.0)
    }
    edges = {name: _from_sides("xyz".index(name[1]), half) for name in pieces}
    return FacedSurface(np.stack([-half, half]), pieces, lambda p: _intersection_distance(*(np.abs(p) - half).T), edges)


def _from_sides(axis: int, half: FloatArray) -> Distance:
    """Return the distance from the edges of a box's side, as a function of a point."""
    return lambda p: float(np.min(np.delete(half - np.abs(p), axis)))


def _side_of_box(axis: int, sign: float, half: FloatArray) -> Piece:
    """Return the ``Piece`` function of one side of a box."""
    outward, tangent_axes = sign * np.eye(3)[axis], [i for i in range(3) if i != axis]
    return lambda p: (
        float(sign * p[axis] - half[axis]),
        outward,
        float(np.max(np.abs(p[tangent_axes]) - half[tangent_axes])),
    )


def cylinder(data: Json, sources: SourceFolders) -> FacedSurface:
    """Return a cylinder with the faces ``side``, ``top`` and ``bottom``."""
    radius, half = number("radius", data["radius"], above=0.0), number("height", data["height"], above=0.0) / 2.0

    def side(p: FloatArray) -> tuple[float, FloatArray, float]:
        distance = float(np.hypot(p[0], p[1]))
        outward = np.array([p[0], p[1], 0.0]) / max(distance, SMALLEST)
        return distance - radius, outward, abs(float(p[2])) - half

    def end(sign: float) -> Piece:
        outward = np.array([0.0, 0.0, sign])
        return lambda p: (float(sign * p[2]) - half, outward, float(np.hypot(p[0], p[1])) - radius)

    def field(p: FloatArray) -> FloatArray:
        return _intersection_distance(np.hypot(p[:, 0], p[:, 1]) - radius, np.abs(p[:, 2]) - half)

    corner = np.array([radius, radius, half])

    def rim(p: FloatArray) -> float:
        return radius - float(np.hypot(p[0], p[1]))

    edges: dict[str, Distance] = {"side": lambda p: half - abs(float(p[2])), "top": rim, "bottom": rim}
    faces = {"side": side, "top": end(1.0), "bottom": end(-1.0)}
    return FacedSurface(np.stack([-corner, corner]), faces, field, edges)


def polygon(data: Json, sources: SourceFolders) -> FacedSurface:
    """Return a polygon with the faces ``edge0``, ``edge1``, ..."""
    v = _counter_clockwise("vertices", data["vertices"])
    pieces = {f"edge{i}": _edge_piece(v, i) for i in range(len(v))}
    edges = {f"edge{i}": from_corners(v, i) for i in range(len(v))}
    return FacedSurface(np.stack([v.min(axis=0), v.max(axis=0)]), pieces, lambda p: _polygon_distance(v, p), edges)


def prism(data: Json, sources: SourceFolders) -> FacedSurface:
    """Return a prism with the faces ``side0``, ``side1``, ..., ``top`` and ``bottom``."""
    v = _counter_clockwise("polygon", data["polygon"])
    half = number("height", data["height"], above=0.0) / 2.0

    def side(edge: Piece) -> Piece:
        def piece(p: FloatArray) -> tuple[float, FloatArray, float]:
            distance, outward, overshoot = edge(p[:2])
            return distance, np.append(outward, 0.0), max(overshoot, abs(float(p[2])) - half)

        return piece

    def end(sign: float) -> Piece:
        outward = np.array([0.0, 0.0, sign])
        return lambda p: (float(sign * p[2]) - half, outward, float(_polygon_distance(v, p[None, :2])[0]))

    def upright(edge_distance: Distance) -> Distance:
        return lambda p: min(edge_distance(p), half - abs(float(p[2])))

    def field(p: FloatArray) -> FloatArray:
        return _intersection_distance(_polygon_distance(v, p[:, :2]), np.abs(p[:, 2]) - half)

    pieces = {f"side{i}": side(_edge_piece(v, i)) for i in range(len(v))} | {"top": end(1.0), "bottom": end(-1.0)}
    bounds = np.stack([np.append(v.min(axis=0), -half), np.append(v.max(axis=0), half)])

    def rim(p: FloatArray) -> float:
        return -float(_polygon_distance(v, p[None, :2])[0])

    edges = {f"side{i}": upright(from_corners(v, i)) for i in range(len(v))} | {"top": rim, "bottom": rim}
    return FacedSurface(bounds, pieces, field, edges)


def _counter_clockwise(field: str, value: object) -> FloatArray:
    """Return a polygon's vertices (n, 2), validated to be counter-clockwise with edges that do not cross."""
    v = array(field, value, (None, 2))
    following = np.roll(v, -1, axis=0)
    if not float(np.sum(v[:, 0] * following[:, 1] - v[:, 1] * following[:, 0])) > 0.0:
        raise InputError(field, value, "counter-clockwise vertices around some area")
    if _edges_intersect(v, following):
        raise InputError(field, value, "edges that do not cross")
    return v


def _edges_intersect(start: FloatArray, end: FloatArray) -> bool:
    """Return whether any two edges of a polygon cross.

    They cross if each has the ends of the other on different sides of its line.
    """

    def side(a: FloatArray, b: FloatArray, p: FloatArray) -> FloatArray:
        """Return on which side of each line from a to b (n, 2) each point (m, 2) is, (n, m)."""
        along, offsets = (b - a)[:, None], p[None] - a[:, None]
        return np.sign(along[..., 0] * offsets[..., 1] - along[..., 1] * offsets[..., 0])

    separates = side(start, end, start) * side(start, end, end) < 0.0
    return bool(np.any(separates & separates.T))


def _edge_piece(v: FloatArray, i: int) -> Piece:
    """Return the ``Piece`` function of one edge of a polygon.

    The edge leads from vertex i of the counter-clockwise polygon to the next.
    """
    start, along = v[i], v[(i + 1) % len(v)] - v[i]
    length = float(np.linalg.norm(along))
    along = along / length
    outward = np.array([along[1], -along[0]])

    def piece(p: FloatArray) -> tuple[float, FloatArray, float]:
        coordinate = float((p - start) @ along)
        return float((p - start) @ outward), outward, max(-coordinate, coordinate - length)

    return piece


def _polygon_distance(v: FloatArray, p: FloatArray) -> FloatArray:
    """Return the signed distances of points (m, 2) from a polygon (n, 2)."""
    along = np.roll(v, -1, axis=0) - v
    offsets = p[:, None] - v[None]  # (m, n, 2)
    t = np.clip(np.sum(offsets * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
    nearest = np.min(np.linalg.norm(offsets - t[..., None] * along, axis=2), axis=1)
    next_offsets = np.roll(offsets, -1, axis=1)
    cross = offsets[..., 0] * next_offsets[..., 1] - offsets[..., 1] * next_offsets[..., 0]
    turns = np.sum(np.arctan2(cross, np.sum(offsets * next_offsets, axis=2)), axis=1)
    return np.asarray(np.where(np.abs(turns) > np.pi, -nearest, nearest))


def _intersection_distance(*parts: FloatArray) -> FloatArray:
    """Return the signed distance from an intersection of sets whose distance gradients are orthogonal."""
    distances = np.stack(parts)
    return np.asarray(np.linalg.norm(np.maximum(distances, 0.0), axis=0) + np.minimum(np.max(distances, axis=0), 0.0))


@dataclass(frozen=True)
class UnknownSurface:
    """An implicit body whose function is not in the file.

    Parameters
    ----------
    bounds : (2, space) array
    """

    bounds: FloatArray
    rough: float = 0.0

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Raise ``NotCheckedError``, as the body's function is not in the file."""
        if face != "surface":
            raise KeyError(face)
        raise NotCheckedError("the body's function stays in the script that made it")

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return infinity, as no sharp edges of the body are known."""
        return np.inf

    def distance(self, points: FloatArray) -> FloatArray:
        """Raise ``NotCheckedError``, as the body's function is not in the file."""
        raise NotCheckedError("the body's function stays in the script that made it")


def implicit(data: Json, sources: SourceFolders) -> UnknownSurface:
    """Return an implicit body of which only the bounding box is in the file."""
    return UnknownSurface(array("bounds", data["bounds"], (2, None)))
