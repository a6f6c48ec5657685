"""Signed distances from the solids around a hand, and penetration depths of convex solids.

Two convex solids A and B overlap if their Minkowski difference, the hull of all ``a - b``, contains the origin; the
origin's distance from its nearest face is the length of the shortest translation that separates them (Cameron and
Culley 1986, doi:10.1109/ROBOT.1986.1087645).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.types import Json
from nlpgrasp.common.unit_directions import directions_around
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.solution.obstructions import BODY, TABLE
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.numeric_constraints import to_body_frame, to_obstacle_frame
from nlpgrasp.verify.stated_placement import NumericBody, StatedPlacement, require_body

CONVEX_SHARE = 0.999  # least share of its hull's volume of a surface that counts as convex
CURVED_SAMPLES = 400  # sample points of a curved surface, or corners of a cylinder
MOST_CORNERS = 64  # most corners of a solid; of more, the extreme ones in as many directions

LEAST_TURN = 0.05  # radians: first turn of a direction that is improved

Distance = Callable[[FloatArray], FloatArray]
"""Function of points (m, space), body frame, to signed distances (m,), metres, negative inside."""


@dataclass(frozen=True)
class NumericSolid:
    """Solid that a hand may collide with.

    Parameters
    ----------
    name : str
    distance : callable
        Points (m, space), body frame, to signed distances (m,), metres, negative inside.
    clearance : float
        Required clearance of a hand, metres.
    rough : float
        Largest excess of the solver's distance over this one, metres.
    corners : (n, 3) array or None
        Corners of a convex solid in space, metres, body frame.
    """

    name: str
    distance: Distance
    clearance: float = 0.0
    rough: float = 0.0
    corners: FloatArray | None = None


def solids_around(constraints: Sequence[Json], placement: StatedPlacement) -> Iterator[NumericSolid]:
    """Yield the tables and obstacles among the constraints as solids."""
    for data in constraints:
        if data["type"] == "table":
            clearance = number("clearance", data["clearance"], at_least=0.0)
            yield NumericSolid(TABLE, partial(_height_above_level, number("height", data["height"])), clearance)
        elif data["type"] == "obstacle":
            clearance = number("clearance", data["clearance"], at_least=0.0)
            surface = placement.surface_of(data["body"])
            solid = solid_body(str(data["name"]), data["body"], surface)
            corners = None if solid.corners is None else to_body_frame(data, solid.corners)
            yield NumericSolid(
                solid.name, partial(_obstacle_distance, data, solid.distance), clearance, surface.rough, corners
            )


def held_and_around(
    solution: GraspSolution, surface: NumericBody | None, placement: StatedPlacement
) -> tuple[NumericSolid, list[NumericSolid]]:
    """Return the held body as a solid, and the tables and obstacles around it as solids.

    Parameters
    ----------
    solution : GraspSolution
    surface : NumericBody or None
        Numeric model of the held body, with its signed distances; None if the body is missing.
    placement : StatedPlacement
        Reader of the obstacles' bodies.

    Raises
    ------
    NotCheckedError
        When the held body is missing, or an obstacle's body cannot be recomputed.
    """
    held = solid_body(BODY, solution.body, require_body(surface))
    return held, list(solids_around(solution.problem["constraints"], placement))


def solid_body(name: str, data: Json, surface: NumericBody) -> NumericSolid:
    """Return a body as a solid in its own frame.

    Parameters
    ----------
    name : str
    data : mapping
        The body's JSON data.
    surface : NumericBody
        The same body.
    """
    return NumericSolid(name, vectorised_distance(surface), corners=convex_corners(data, surface))


def vectorised_distance(surface: NumericBody) -> Distance:
    """Return the function from points (m, space) to their signed distances from a body, metres.

    For a mesh, the function uses a search tree.
    """
    if isinstance(surface, MeshSurface):
        return SearchTree(surface.triangles.vertices, surface.triangles.faces).exact_signed_distance
    return surface.distance


def _height_above_level(height: float, points: FloatArray) -> FloatArray:
    """Return the heights of points (m, space) above a horizontal plane, metres."""
    return np.asarray(points[:, -1] - height)


def _obstacle_distance(data: Json, distance: Distance, points: FloatArray) -> FloatArray:
    """Return the signed distances of points (m, space) in the body's frame from an obstacle, metres.

    ``distance`` takes points in the obstacle's frame.
    """
    return distance(to_obstacle_frame(data, points))


def convex_corners(data: Json, surface: NumericBody) -> FloatArray | None:
    """Return the corners (n, 3) of a convex body in its own frame, metres; None for any other body.

    Parameters
    ----------
    data : mapping
        The body's JSON data.
    surface : NumericBody
        The same body.
    """
    if isinstance(surface, MeshSurface):
        return mesh_corners(surface.triangles.vertices, surface.triangles.corners)
    kind, half = data["type"], np.max(surface.bounds, axis=0)
    directions = directions_around(np.eye(3)[2], CURVED_SAMPLES)
    if kind == "box":
        return np.asarray(half * np.array(list(product((-1.0, 1.0), repeat=3))))
    if kind in ("sphere", "ellipsoid"):
        return np.asarray(half * directions)
    if kind == "superquadric":
        return np.asarray(half * _on_superquadric(directions, *array("exponents", data["exponents"], (2,))))
    if kind in ("cylinder", "prism"):
        angles = 2.0 * np.pi * np.arange(CURVED_SAMPLES // 2) / (CURVED_SAMPLES // 2)
        ring = half[:2] * np.column_stack([np.cos(angles), np.sin(angles)])
        outline = ring if kind == "cylinder" else array("polygon", data["polygon"], (None, 2))
        height = number("height", data["height"]) / 2.0
        return np.concatenate([np.column_stack([outline, np.full(len(outline), z)]) for z in (-height, height)])
    return None


def _on_superquadric(directions: FloatArray, e1: float, e2: float) -> FloatArray:
    """Return the points (m, 3) in which rays from the origin meet a superquadric of semi-axes 1."""
    x, y, z = np.abs(directions).T
    flat = (x ** (2.0 / e2) + y ** (2.0 / e2)) ** (e2 / e1)
    return np.asarray(directions / (flat + z ** (2.0 / e1))[:, None] ** (e1 / 2.0))


def mesh_corners(vertices: FloatArray, triangles: FloatArray) -> FloatArray | None:
    """Return the corners (n, 3) of a closed triangle surface if it is convex, else None.

    Parameters
    ----------
    vertices : (m, 3) array
    triangles : (f, 3, 3) array
    """
    try:
        hull = ConvexHull(vertices)
    except QhullError:  # coplanar points
        return None
    volume = abs(float(np.sum(np.linalg.det(triangles - vertices.mean(axis=0))))) / 6.0
    return vertices[hull.vertices] if volume >= CONVEX_SHARE * hull.volume else None


def penetration_depth(first: FloatArray, second: FloatArray) -> float:
    """Return the length of the shortest translation that separates two convex solids, metres; 0 if they are apart.

    Parameters
    ----------
    first, second : (n, 3) and (m, 3) arrays
        Their corners. Of more than ``MOST_CORNERS`` the extreme ones give the directions of the translation that are
        tried; the best is improved by the simplex method of Nelder and Mead, with all corners.
    """
    differences = (_hull_corners(first)[:, None] - _hull_corners(second)[None]).reshape(-1, 3)
    equations = ConvexHull(differences).equations
    if max(len(first), len(second)) <= MOST_CORNERS:
        return max(0.0, float(-np.max(equations[:, 3])))

    def overlap(normals: FloatArray) -> FloatArray:
        return np.asarray(np.max(first @ normals.T, axis=0) - np.min(second @ normals.T, axis=0))

    best = equations[int(np.argmin(overlap(equations[:, :3]))), :3]
    tangents = np.linalg.svd(best[None])[2][1:]

    def overlap_beside(turn: FloatArray) -> float:
        normal = best + turn @ tangents
        return float(overlap(normal[None] / np.linalg.norm(normal))[0])

    corners = np.array([[0.0, 0.0], [LEAST_TURN, 0.0], [0.0, LEAST_TURN]])
    minimum = minimize(
        overlap_beside,
        corners[0],
        method="Nelder-Mead",
        options={"initial_simplex": corners, "xatol": 1e-4, "fatol": 1e-7, "maxfev": 80},
    )
    return max(0.0, float(minimum.fun))


def _hull_corners(corners: FloatArray) -> FloatArray:
    """Return corners (n, 3) of a convex solid, at most ``MOST_CORNERS``: extreme ones if it has more."""
    if len(corners) <= MOST_CORNERS:
        return corners
    return np.asarray(corners[np.unique(np.argmax(directions_around(np.eye(3)[2], MOST_CORNERS) @ corners.T, axis=1))])
