"""Parts of 3D scenes: shaded surfaces, axes, camera, tables and obstacles."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from nlpgrasp.bodies import Body, Box
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.types import Json
from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution

CREASE = 30.0  # degrees between triangles above which their common edge is a crease
MOST_LOOSE_ENDS = 0.1  # share of loose ends among crease vertices above which creases are noise and not drawn
MERGE_DISTANCE = 1e-6  # share of the size: nearer vertices are merged
NORMAL_STEPS = 32767  # quantisation steps of a normal's component
FARTHEST_ORIGIN = 2.0  # largest distance of a drawn origin from the body's middle, in body sizes
AXIS_LENGTH, AXIS_OVERHANG = 0.5, 0.3  # least length of an axis, and its length beyond the body, in body sizes
DIGITS = 7  # decimals of coordinates for display, metres
FRAME_RADIUS = 4.0  # distance from the body's middle, in body sizes, beyond which points may leave the view
# radians: azimuths and elevations among which a view is chosen
AZIMUTHS, ELEVATIONS = np.radians(np.arange(-180.0, 180.0, 15.0)), np.radians([18.0, 28.0, 40.0])
TOP_VIEW = (-90.0, 74.0)  # azimuth and elevation for a planar grasp, degrees
OBLIQUE_VIEW = (-55.0, 25.0)  # degrees: view of a body without contacts, and for ties
FULLY_VISIBLE = 0.65  # cosine to the view direction above which contacts are equally visible
FULLY_HIDDEN = -0.3  # cosine below which contacts are equally hidden
OBSTACLE_TRIANGLES = 1000  # most triangles of an obstacle
TABLE_HALF_WIDTH, TABLE_THICKNESS = 2.5, 0.05  # half width of a table, thickness of a planar one, in body sizes


@dataclass(frozen=True)
class ShadedSurface:
    """Triangle surface with vertex normals and creases.

    Parameters
    ----------
    positions, normals : (n, 3) array
        Metres; unit, outward. A vertex on a crease occurs once for each side.
    faces : (m, 3) array of int
    edges : (k, 2, 3) array
        Ends of the creases, metres; none for a noisy surface.
    """

    positions: FloatArray
    normals: FloatArray
    faces: IntArray
    edges: FloatArray

    def to_dict(self) -> Json:
        """Return the surface as JSON data with arrays in base64.

        Arrays are little-endian: 32-bit floats, 16-bit normals and integers.
        """
        wide = len(self.positions) > np.iinfo(np.uint16).max
        return {
            "positions": pack(self.positions, "<f4"),
            "normals": pack(np.round(NORMAL_STEPS * self.normals), "<i2"),
            "faces": pack(self.faces, "<u4" if wide else "<u2"),
            "wide": wide,
            "edges": pack(self.edges, "<f4"),
        }


def surface(shape: Triangles, crease: float = CREASE) -> ShadedSurface:
    """Return a triangle surface with vertex normals and creases for shading.

    A vertex normal is the angle-weighted mean over the adjacent triangles within the crease angle.

    Parameters
    ----------
    shape : Triangles
        Counter-clockwise from outside.
    crease : float
        Degrees. The mean is weighted by the triangles' angles at the vertex (Thuermer and Wuethrich 1998).
    """
    vertices, faces = _merge_vertices(shape)
    corners = vertices[faces]
    normals = triangle_normals(corners)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    crease_cosine = float(np.cos(np.radians(crease)))
    triangle_of_corner, vertex_index = np.repeat(np.arange(len(faces)), 3), faces.ravel()
    count = len(vertex_index)
    entries = np.ones(count), (np.arange(count), vertex_index)
    incidence = coo_matrix(entries, shape=(count, len(vertices))).tocsr()
    pairs = (incidence @ incidence.T).tocoo()  # pairs of corners at one vertex
    corner_normals = normals[triangle_of_corner]
    is_smooth = np.sum(corner_normals[pairs.row] * corner_normals[pairs.col], axis=1) >= crease_cosine
    row, col = pairs.row[is_smooth], pairs.col[is_smooth]
    weighted = corner_normals * _corner_angles(corners).ravel()[:, None]
    mean = np.stack([np.bincount(row, weighted[col, i], count).astype(float) for i in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    key = np.column_stack([vertex_index, np.round(1e3 * mean)])
    _, first_corner, vertex_of_corner = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return ShadedSurface(
        vertices[vertex_index[first_corner]],
        mean[first_corner],
        vertex_of_corner.reshape(-1, 3),
        _creases(vertices, faces, normals, crease_cosine),
    )


def pack(values: NDArray[np.float64] | IntArray, kind: str) -> str:
    """Return numbers of a given numpy type as base64 text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def subdivide(shape: Triangles, least_count: int) -> FloatArray:
    """Return the corners (m, 3, 3) of triangles, subdivided into four each until there are ``least_count``."""
    corners = shape.vertices[shape.faces]
    while 0 < len(corners) < least_count:
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return corners


def triangle_normals(corners: FloatArray) -> FloatArray:
    """Return the outward normals (m, 3) of triangles (m, 3, 3), whose lengths are twice the areas."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _merge_vertices(shape: Triangles) -> tuple[FloatArray, IntArray]:
    """Return the vertices with coinciding ones merged, and the triangles that keep three distinct ones."""
    step = MERGE_DISTANCE * max(float(np.max(np.ptp(shape.vertices, axis=0), initial=0.0)), 1e-300)
    _, representatives, merged_index = np.unique(
        np.round(shape.vertices / step), axis=0, return_index=True, return_inverse=True
    )
    faces = merged_index.ravel()[shape.faces]
    a, b, c = faces.T
    return shape.vertices[representatives], faces[(a != b) & (b != c) & (c != a)]


def _corner_angles(corners: FloatArray) -> FloatArray:
    """Return the angles of triangles (m, 3, 3) at their corners, (m, 3), radians."""
    to_next = np.roll(corners, -1, axis=1) - corners
    to_previous = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(to_next, to_previous), axis=2)
    return np.asarray(np.arctan2(across, np.sum(to_next * to_previous, axis=2)))


def _creases(vertices: FloatArray, faces: IntArray, normals: FloatArray, crease_cosine: float) -> FloatArray:
    """Return the edges (k, 2, 3) between triangles that meet at more than the crease angle.

    There are none if too many of their vertices are loose ends, where a single such edge ends.
    """
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    triangle_of_edge = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(ends.T)
    ends, triangle_of_edge = ends[order], triangle_of_edge[order]
    shared = np.flatnonzero(np.all(ends[1:] == ends[:-1], axis=1))
    sharp = np.sum(normals[triangle_of_edge[shared]] * normals[triangle_of_edge[shared + 1]], axis=1) < crease_cosine
    edges = ends[shared[sharp]]
    degrees = np.bincount(edges.ravel(), minlength=1)
    is_broken = np.sum(degrees == 1) > MOST_LOOSE_ENDS * np.sum(degrees > 0)
    return np.zeros((0, 2, 3)) if is_broken else vertices[edges]


def has_origin(low: FloatArray, high: FloatArray, size: float) -> bool:
    """Return whether the origin of a body's frame is near enough to the body to be drawn.

    Parameters
    ----------
    low, high : (3,) array
        Ends of the body's bounds, metres.
    size : float
        Of the body, metres.
    """
    return float(np.linalg.norm((low + high) / 2.0)) <= FARTHEST_ORIGIN * size


def body_axes(low: FloatArray, high: FloatArray, size: float, count: int = 3) -> Json:
    """Return the drawn axes of a body's frame, at the origin or, if that is far away, at the body's lowest corner.

    Parameters
    ----------
    low, high : (3,) array
        Ends of the body's bounds, metres.
    size : float
        Of the body, metres.
    count : int
        2 for a planar body, else 3.

    Returns
    -------
    dict
        ``at``: their origin; ``ends``: ends of x, y and z; metres, body frame.
    """
    origin = np.zeros(3) if has_origin(low, high, size) else low
    is_inside = (low <= origin) & (origin <= high)
    lengths = np.maximum(AXIS_LENGTH * size, np.where(is_inside, high - origin + AXIS_OVERHANG * size, 0.0))
    return frame_axes(origin, lengths[:count])


def frame_axes(origin: FloatArray, lengths: FloatArray) -> Json:
    """Return axes of given lengths (k,) at a point (3,), metres.

    The format is that of ``body_axes``.
    """
    ends = origin + np.diag(np.pad(lengths, (0, 3 - len(lengths))))[: len(lengths)]
    return {"at": np.round(origin, DIGITS).tolist(), "ends": np.round(ends, DIGITS).tolist()}


def outermost_points(points: FloatArray, middle: FloatArray, size: float) -> FloatArray:
    """Return the points (m, 3) that are farthest along some sampled direction, among points (n, 3) near a middle.

    Near means within ``FRAME_RADIUS`` body sizes.
    """
    in_frame = points[np.linalg.norm(points - middle, axis=1) <= FRAME_RADIUS * size]
    samples = np.concatenate([directions(3, 0), directions(3, 2)])
    return np.asarray(in_frame[np.unique(np.argmax(in_frame @ samples.T, axis=0))])


def view_directions(azimuth: FloatArray | float, elevation: FloatArray | float) -> FloatArray:
    """Return the unit directions (..., 3) towards the camera for azimuth and elevation in radians."""
    horizontal = np.cos(elevation)
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)], axis=-1)


def first_view(solution: GraspSolution, flat: bool) -> list[float]:
    """Return azimuth and elevation, degrees, of the view in which most contacts are visible."""
    if flat or solution.grasp is None:
        return list(TOP_VIEW if flat else OBLIQUE_VIEW)
    outward = -in_space(solution.grasp.normals)
    azimuth, elevation = (x.ravel() for x in np.meshgrid(AZIMUTHS, ELEVATIONS, indexing="ij"))
    eyes = view_directions(azimuth, elevation)
    visibility = np.clip(eyes @ outward.T, FULLY_HIDDEN, FULLY_VISIBLE).sum(axis=1)
    visibility = visibility + 0.02 * np.cos(azimuth - np.radians(OBLIQUE_VIEW[0]))  # for ties
    best = int(np.argmax(visibility))
    return [float(np.degrees(azimuth[best])), float(np.degrees(elevation[best]))]


@dataclass(frozen=True)
class DrawnSurroundings:
    """Tables and obstacles around a body.

    Parameters
    ----------
    heights : tuple of float
        Heights of the tables' tops, metres: along z, or along y for a planar body.
    obstacles : tuple of (str, Triangles)
        Names and triangles, body frame.
    unseen : tuple of str
        Obstacles whose surface the file does not contain, such as meshes.
    """

    heights: tuple[float, ...]
    obstacles: tuple[tuple[str, Triangles], ...]
    unseen: tuple[str, ...]


def drawn_surroundings(solution: GraspSolution) -> DrawnSurroundings:
    """Return the tables and obstacles of a solution's problem."""
    kinds = {kind.kind: kind for kind in (Table, Obstacle)}
    constraints: list[PlacementConstraint] = []
    unreadable = []
    for data in solution.problem.get("constraints", []):
        if (kind := kinds.get(data.get("type"))) is not None:
            try:
                constraints.append(kind.from_dict(data))
            except InputError:
                unreadable.append(str(data.get("name", kind.kind)))
    surroundings = surroundings_of(constraints)
    return replace(surroundings, unseen=(*unreadable, *surroundings.unseen))


def surroundings_of(constraints: Iterable[PlacementConstraint]) -> DrawnSurroundings:
    """Return the tables and obstacles among the constraints of a problem."""
    heights, obstacles, undrawn = [], [], []
    for constraint in constraints:
        if isinstance(constraint, Table):
            heights.append(constraint.height)
        elif isinstance(constraint, Obstacle):
            try:
                obstacles.append((constraint.name, obstacle_surface(constraint)))
            except InputError:
                undrawn.append(constraint.name)
    return DrawnSurroundings(tuple(heights), tuple(obstacles), tuple(undrawn))


def obstacle_surface(obstacle: Obstacle) -> Triangles:
    """Return an obstacle's surface in its pose, body frame.

    Raises
    ------
    InputError
        When its body is not one of this package's, so that its surface is unknown.
    """
    if not isinstance(obstacle.body, Body):
        raise InputError("Obstacle.body", obstacle.body, "a body")
    vertices, faces = triangles(obstacle.body, OBSTACLE_TRIANGLES)
    rotation, position = np.eye(3), np.zeros(3)
    rotation[: obstacle.body.space, : obstacle.body.space] = obstacle.rotation
    if obstacle.position is not None:
        position[: obstacle.body.space] = np.asarray(obstacle.position)
    return Triangles(vertices @ rotation.T + position, faces)


def slab(height: float, body: FloatArray, size: float) -> Triangles:
    """Return a bar that shows a table under a planar body, with its top at the table's height.

    Parameters
    ----------
    height : float
        Along y, metres.
    body : (n, 3) array
        The drawn body's vertices.
    size : float
        The drawn body's, metres.
    """
    thickness = TABLE_THICKNESS * size
    depth = float(np.ptp(body[:, 2])) or thickness
    vertices, faces = triangles(Box([2.0 * TABLE_HALF_WIDTH * size, thickness, depth]))
    middle = (body.min(axis=0) + body.max(axis=0)) / 2.0
    return Triangles(vertices + np.array([middle[0], height - thickness / 2.0, 0.0]), faces)
