"""Access to a body's surface for all methods: random points, face functions with derivatives, and triangles."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

import nlpgrasp as ng
from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import FloatArray


def random_points(body: Body, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return about ``count`` random points of a body, their inward normals, (m, 3) each, metres, and faces.

    Uniform by area on meshes; as many on each face of other bodies.
    """
    if isinstance(body, ng.Mesh):
        points, outward = body.surface_samples(count, rng)
        return points, -outward, ["surface"] * count
    point_sets, normals, names = [], [], []
    for name in body.face_names:
        points = body.sample(name, -(-count // len(body.face_names)), rng)
        point_sets.append(points)
        normals.append(-body.evaluate(name, points)[2])
        names += [name] * len(points)
    return np.concatenate(point_sets), np.concatenate(normals), names


def nearest_faces(body: Body, points: FloatArray) -> list[str]:
    """Return the name of the face nearest to each point (m, 3)."""
    distances = []
    for name in body.face_names:
        h, slope, _, extent = body.evaluate(name, points)
        distances.append(np.abs(h / slope) + np.maximum(extent, 0.0))
    return [body.face_names[i] for i in np.argmin(distances, axis=0)]


def project(body: Body, faces: Sequence[str], points: FloatArray) -> FloatArray:
    """Project points (k, 3) near a body onto their faces."""
    if isinstance(body, ng.Mesh):
        return body.closest(points)[0]
    return np.concatenate([body.snap(name, p[None]) for name, p in zip(faces, points, strict=True)])


def triangles(body: Body) -> FloatArray:
    """Return the body's triangles, (m, 3, 3), metres."""
    if isinstance(body, ng.Mesh):
        return np.asarray(body.mesh.triangles)
    drawn = body.triangles()
    if drawn is None:
        raise ValueError(f"{body.kind} states no triangles")
    return np.asarray(drawn[0][drawn[1]])


class FaceFunction:
    """Numerical function of a face, with lengths in units of the body's size.

    Parameters
    ----------
    body : Body
    name : str
        Of the face.
    """

    def __init__(self, body: Body, name: str) -> None:
        self._size = body.size
        p = body.point()
        h, slope, outward, limits = body.surface_function(name)(p)
        inward, distance = -outward, h / slope
        values = [distance, inward, limits]
        self._values = ca.Function("values", [p], values)
        self._all = ca.Function("all", [p], [*values, *(ca.jacobian(v, p) for v in values)])

    def values(self, p: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return distance to the face, inward normal (3,) and limits (e,) at a point ``p`` (3,)."""
        distance, normal, limits = (np.asarray(v.full()).ravel() for v in self._values(p * self._size))
        return float(distance[0]) / self._size, normal, limits / self._size

    def derivatives(self, p: FloatArray) -> tuple[FloatArray, ...]:
        """Return distance, normal and limits with their derivatives: (1,), (3,), (e,), (1, 3), (3, 3), (e, 3)."""
        d, n, e, dd, dn, de = (np.asarray(v.full()) for v in self._all(p * self._size))
        return d.ravel() / self._size, n.ravel(), e.ravel() / self._size, dd, dn * self._size, de


def face_functions(body: Body, faces: Sequence[str]) -> list[FaceFunction]:
    """Return the numerical function of each contact's face."""
    functions = {name: FaceFunction(body, name) for name in set(faces)}
    return [functions[name] for name in faces]
