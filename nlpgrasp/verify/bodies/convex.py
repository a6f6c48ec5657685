"""Convex bodies by their corners, and the shortest translation that parts two of them.

Two convex solids A and B overlap where their Minkowski difference, the hull of all ``a - b``, holds the origin; the
origin's distance from the nearest of its faces is the length of the shortest translation that parts them (Cameron and
Culley 1986, doi:10.1109/ROBOT.1986.1087645).
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.directions import directions_around
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bodies.mesh import MeshSurface
from nlpgrasp.verify.placement import Surface

CONVEX = 0.999  # of its hull's volume: what counts as convex
AROUND = 400  # points of a curved surface that stand for it, or corners of a cylinder
CORNERS = 64  # of a solid, at most: of more the outermost ones in as many directions


def convex_corners(data: Json, surface: Surface) -> FloatArray | None:
    """Return the corners (n, 3) of a convex body in its own frame, metres; None of any other body.

    Parameters
    ----------
    data : mapping
        The body's JSON data.
    surface : Surface
        The same body.
    """
    if isinstance(surface, MeshSurface):
        return mesh_corners(surface.triangles.vertices, surface.triangles.corners)
    kind, half = data["type"], np.max(surface.bounds, axis=0)
    around = directions_around(np.eye(3)[2], AROUND)
    if kind == "box":
        return np.asarray(half * np.array(list(product((-1.0, 1.0), repeat=3))))
    if kind in ("sphere", "ellipsoid"):
        return np.asarray(half * around)
    if kind == "superquadric":
        return np.asarray(half * _on_superquadric(around, *array("exponents", data["exponents"], (2,))))
    if kind in ("cylinder", "prism"):
        angles = 2.0 * np.pi * np.arange(AROUND // 2) / (AROUND // 2)
        ring = half[:2] * np.column_stack([np.cos(angles), np.sin(angles)])
        outline = ring if kind == "cylinder" else array("polygon", data["polygon"], (None, 2))
        height = number("height", data["height"]) / 2.0
        return np.concatenate([np.column_stack([outline, np.full(len(outline), z)]) for z in (-height, height)])
    return None


def mesh_corners(vertices: FloatArray, triangles: FloatArray) -> FloatArray | None:
    """Return the corners (n, 3) of a closed convex surface; None of one that is not convex.

    Parameters
    ----------
    vertices : (m, 3) array
    triangles : (f, 3, 3) array
    """
    try:
        hull = ConvexHull(vertices)
    except QhullError:  # all in one plane
        return None
    volume = abs(float(np.sum(np.linalg.det(triangles - vertices.mean(axis=0))))) / 6.0
    return vertices[hull.vertices] if volume >= CONVEX * hull.volume else None


def way_out(one: FloatArray, other: FloatArray) -> float:
    """Return the length of the shortest translation that parts two convex solids, metres; 0 where they are apart.

    Parameters
    ----------
    one, other : (n, 3) and (m, 3) arrays
        Their corners. Of more than ``CORNERS`` the outermost ones are taken, which makes a round solid smaller by up to
        six hundredths.
    """
    differences = (_outermost(one)[:, None] - _outermost(other)[None]).reshape(-1, 3)
    return max(0.0, float(-np.max(ConvexHull(differences).equations[:, 3])))


def _outermost(corners: FloatArray) -> FloatArray:
    if len(corners) <= CORNERS:
        return corners
    return np.asarray(corners[np.unique(np.argmax(directions_around(np.eye(3)[2], CORNERS) @ corners.T, axis=1))])


def _on_superquadric(directions: FloatArray, e1: float, e2: float) -> FloatArray:
    """Return the points (m, 3) in some directions of a superquadric whose semi-axes are 1."""
    x, y, z = np.abs(directions).T
    flat = (x ** (2.0 / e2) + y ** (2.0 / e2)) ** (e2 / e1)
    return np.asarray(directions / (flat + z ** (2.0 / e1))[:, None] ** (e1 / 2.0))
