"""Faces of each kind of body as unions of cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.bodies import Body, Box, Cylinder, Ellipsoid, Mesh, Polygon, Prism, Sphere, Torus
from nlpgrasp.bodies.base import SHARP, exterior_angles
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace
from nlpgrasp.global_bound.cells.ellipsoid_cells import EllipsoidFace
from nlpgrasp.global_bound.cells.flat_cells import FlatFaceCells, clip
from nlpgrasp.global_bound.cells.mesh_cells import MeshFace
from nlpgrasp.global_bound.cells.revolved_cells import DiscFace, RevolvedFace

Faces = list[CellFace]


def surfaces(body: Body, margin: float = 0.0) -> Faces | None:
    """Return the faces of a body in the order of their names, or None for a kind that no cells are known for.

    Parameters
    ----------
    body : Body
    margin : float
        From sharp edges, metres: a face without room for it is left out. A mesh's one face is the whole surface all the
        same.
    """
    for kind, make in MAKERS:
        if type(body) is kind:
            return make(body, margin)
    return None


def _box_faces(body: Box, margin: float) -> Faces:
    half = body.half_size
    result: Faces = []
    for name in body.face_names:
        axis, sign = "xyz".index(name[1]), 1.0 if name[0] == "+" else -1.0
        beside, across = (i for i in range(3) if i != axis)
        if min(half[beside], half[across]) <= margin:
            continue
        corners = np.zeros((4, 3))
        corners[:, axis] = sign * half[axis]
        corners[:, beside] = (half[beside] - margin) * np.array([1.0, -1.0, -1.0, 1.0])
        corners[:, across] = (half[across] - margin) * np.array([1.0, 1.0, -1.0, -1.0])
        result.append(FlatFaceCells(name, [corners], -sign * np.eye(3)[axis]))
    return result


def _polygon_faces(body: Polygon, margin: float) -> Faces:
    each = enumerate(_polygon_edges(body.corners, margin))
    return [FlatFaceCells(f"edge{i}", [ends], normal) for i, (ends, normal) in each if ends is not None]


def _prism_faces(body: Prism, margin: float) -> Faces:
    half = body.height / 2.0
    result: Faces = []
    for i, (ends, normal) in enumerate(_polygon_edges(body.corners, margin)):
        if ends is not None and half > margin:
            low, high = (np.column_stack([ends, np.full(2, z)]) for z in (margin - half, half - margin))
            result.append(FlatFaceCells(f"side{i}", [np.concatenate([low, high[::-1]])], np.append(normal, 0.0)))
    flat = _inset_polygon(body.corners, margin)
    for name, z in (("top", half), ("bottom", -half)) if len(flat) else ():
        corners = np.column_stack([flat, np.full(len(flat), z)])
        result.append(FlatFaceCells(name, [corners], np.array([0.0, 0.0, -np.sign(z)])))
    return result


def _polygon_edges(corners: FloatArray, margin: float) -> list[tuple[FloatArray | None, FloatArray]]:
    """Return both ends, None without room, and the inward unit normal of each edge of a polygon, counter-clockwise."""
    result: list[tuple[FloatArray | None, FloatArray]] = []
    back = margin * (np.abs(exterior_angles(corners)) > SHARP)
    following = zip(np.roll(corners, -1, axis=0), np.roll(back, -1), strict=True)
    for start, here, (end, there) in zip(corners, back, following, strict=True):
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        ends = np.stack([start + here * along, end - there * along]) if here + there < length else None
        result.append((ends, np.array([-along[1], along[0]])))
    return result


def _inset_polygon(corners: FloatArray, margin: float) -> FloatArray:
    """Return the part of a convex polygon (m, 2), counter-clockwise, that is a margin away from all its edges."""
    inside = corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True) if margin > 0.0 else ():
        along = (end - start) / np.linalg.norm(end - start)
        outward = np.array([along[1], -along[0]])
        inside = clip(inside, outward, float(outward @ start) - margin)
        if len(inside) < 3:
            return np.zeros((0, 2))
    return inside


def _sphere_faces(body: Sphere, margin: float) -> Faces:
    del margin
    return [EllipsoidFace("surface", np.full(3, float(body.radius)))]


def _ellipsoid_faces(body: Ellipsoid, margin: float) -> Faces:
    del margin
    return [EllipsoidFace("surface", body.half_size)]


def _cylinder_faces(body: Cylinder, margin: float) -> Faces:
    half, radius = body.height / 2.0, body.radius - margin
    ends = [DiscFace(n, radius, s * half, np.array([0.0, 0.0, -s])) for n, s in (("top", 1.0), ("bottom", -1.0))]
    side = RevolvedFace("side", np.array([0.0, body.radius]), np.array([margin - half, half - margin]))
    return [*([side] if half > margin else []), *(ends if radius > 0.0 else [])]


def _torus_faces(body: Torus, margin: float) -> Faces:
    del margin
    return [RevolvedFace("surface", np.array([body.major_radius, body.minor_radius]), np.array([-np.pi, np.pi]))]


def _mesh_faces(body: Mesh, margin: float) -> Faces:
    del margin
    return [MeshFace("surface", body)]


MAKERS: list[tuple[type, Callable[..., Faces]]] = [
    (Box, _box_faces),
    (Polygon, _polygon_faces),
    (Prism, _prism_faces),
    (Sphere, _sphere_faces),
    (Ellipsoid, _ellipsoid_faces),
    (Cylinder, _cylinder_faces),
    (Torus, _torus_faces),
    (Mesh, _mesh_faces),
]
