"""The faces of each kind of body as surfaces made of cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.best.cells.base import Surface
from nlpgrasp.best.cells.curved.ellipsoid import EllipsoidFace
from nlpgrasp.best.cells.curved.revolved import RevolvedFace
from nlpgrasp.best.cells.curved.superquadric import SuperquadricFace
from nlpgrasp.best.cells.disc import DiscFace
from nlpgrasp.best.cells.mesh import MeshFace
from nlpgrasp.best.cells.polygon import FlatFace
from nlpgrasp.bodies import Body, Box, Cylinder, Ellipsoid, Mesh, Polygon, Prism, Sphere, Superquadric, Torus
from nlpgrasp.common.validation import FloatArray

Faces = list[Surface]


def surfaces(body: Body) -> Faces | None:
    """Return the faces of a body in the order of their names, or None for a kind that no cells are known for."""
    for kind, make in MAKERS:
        if type(body) is kind:
            return make(body)
    return None


def _box(body: Box) -> Faces:
    half = body.half_size
    result: Faces = []
    for name in body.face_names:
        axis, sign = "xyz".index(name[1]), 1.0 if name[0] == "+" else -1.0
        beside, across = (i for i in range(3) if i != axis)
        corners = np.zeros((4, 3))
        corners[:, axis] = sign * half[axis]
        corners[:, beside] = half[beside] * np.array([1.0, -1.0, -1.0, 1.0])
        corners[:, across] = half[across] * np.array([1.0, 1.0, -1.0, -1.0])
        result.append(FlatFace(name, [corners], -sign * np.eye(3)[axis]))
    return result


def _polygon(body: Polygon) -> Faces:
    return [FlatFace(f"edge{i}", [ends], normal) for i, (ends, normal) in enumerate(_edges(body.corners))]


def _prism(body: Prism) -> Faces:
    half = body.height / 2.0
    result: Faces = []
    for i, (ends, normal) in enumerate(_edges(body.corners)):
        low, high = (np.column_stack([ends, np.full(2, z)]) for z in (-half, half))
        result.append(FlatFace(f"side{i}", [np.concatenate([low, high[::-1]])], np.append(normal, 0.0)))
    for name, z in (("top", half), ("bottom", -half)):
        corners = np.column_stack([body.corners, np.full(len(body.corners), z)])
        result.append(FlatFace(name, [corners], np.array([0.0, 0.0, -np.sign(z)])))
    return result


def _edges(corners: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return both ends and the inward unit normal of each edge of a polygon, counter-clockwise."""
    result = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        result.append((np.stack([start, end]), np.array([-along[1], along[0]])))
    return result


def _sphere(body: Sphere) -> Faces:
    return [EllipsoidFace("surface", np.full(3, float(body.radius)))]


def _ellipsoid(body: Ellipsoid) -> Faces:
    return [EllipsoidFace("surface", body.half_size)]


def _superquadric(body: Superquadric) -> Faces:
    return [SuperquadricFace("surface", body.half_size, np.asarray(body.exponents, dtype=float))]


def _cylinder(body: Cylinder) -> Faces:
    half = body.height / 2.0
    ends = [DiscFace(n, body.radius, s * half, np.array([0.0, 0.0, -s])) for n, s in (("top", 1.0), ("bottom", -1.0))]
    return [RevolvedFace("side", np.array([0.0, body.radius]), np.array([-half, half])), *ends]


def _torus(body: Torus) -> Faces:
    return [RevolvedFace("surface", np.array([body.major_radius, body.minor_radius]), np.array([-np.pi, np.pi]))]


def _mesh(body: Mesh) -> Faces:
    return [MeshFace("surface", body)]


MAKERS: list[tuple[type, Callable[..., Faces]]] = [
    (Box, _box),
    (Polygon, _polygon),
    (Prism, _prism),
    (Sphere, _sphere),
    (Ellipsoid, _ellipsoid),
    (Superquadric, _superquadric),
    (Cylinder, _cylinder),
    (Torus, _torus),
    (Mesh, _mesh),
]
