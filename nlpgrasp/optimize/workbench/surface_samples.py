"""Surface samples of the body for drawing contacts and sliding them on a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.direction import off_normal
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import FITS

CLOUD, LEAST = 2400, 600  # sample points for drawing contacts: in all; per face, at least
MESH_SAMPLES = 20000  # mesh points for sliding contacts
MESH_ANGLE = np.radians(30.0)  # most between mesh normal and smooth normal: avoids sharp edges


@dataclass(frozen=True)
class Cloud:
    """Surface points with normals, faces and a k-d tree.

    Parameters
    ----------
    faces : (m,) array of str
        The face each point is on.
    points : (m, space) array
        Metres.
    normals : (m, space) array
        Unit, into the body.
    tree : scipy.spatial.cKDTree
    """

    faces: NDArray[np.object_]
    points: FloatArray
    normals: FloatArray
    tree: cKDTree

    def subset(self, kept: NDArray[np.intp]) -> Cloud:
        """Return the points with these numbers (m,)."""
        points = self.points[kept]
        return Cloud(self.faces[kept], points, self.normals[kept], cKDTree(points))


def mesh_of(problem: GraspProblem) -> Mesh:
    """Return a problem's body, which must be a mesh."""
    if not isinstance(problem.body, Mesh):
        raise InputError("GraspProblem.body", type(problem.body).__name__, "a mesh")
    return problem.body


def plain(problem: GraspProblem, points: FloatArray, outward: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of mesh points (m, 3), with outward normals (m, 3), that a contact may use.

    They are the margin away from sharp edges, the normals there are near those of the smooth surface, and the largest
    fingertip that is where its contact is cuts the mesh nowhere.
    """
    body, face, hand = mesh_of(problem), problem.body.face_names[0], problem.hand
    kept = np.sum(body.evaluate(face, points)[2] * outward, axis=1) >= np.cos(MESH_ANGLE)
    if directions := _directions(problem):
        kept &= _told(directions, outward)
    if problem.margin > 0.0:
        kept &= body.edge_distance(face, points) >= problem.margin
    radius = 0.0 if hand is None or not hand.follows_contacts else max(hand.tip_radii)
    if radius > 0.0:
        kept[kept] = body.clearance((points + radius * outward)[kept]) >= FITS * radius
    return np.asarray(kept)


def _directions(problem: GraspProblem) -> list[tuple[float, ...]]:
    """Return the directions of lines and rectangles among the contacts."""
    each = (getattr(model, "direction", None) for model in problem.models) if problem.body.space == 3 else ()
    return [direction for direction in each if direction is not None]


def _told(directions: Sequence[tuple[float, ...]], outward: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of unit normals (m, 3) at which all directions determine a line's or rectangle's orientation."""
    return np.asarray(np.all([off_normal(direction, outward) for direction in directions], axis=0))


class SurfaceSamples:
    """Surface samples of a problem's body, identical in every process.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        self._clouds: dict[tuple[str, ...], Cloud] = {}

    @cached_property
    def faces(self) -> dict[str, FloatArray]:
        """Points on each face that some contact may use, (m, space)."""
        problem, k = self._problem, len(self._problem.models)
        names = sorted({n for i in range(k) for n in problem.allowed_faces(i)})
        rng = np.random.default_rng(0)
        count = max(LEAST, CLOUD // len(names))
        found = {name: problem.body.sample(name, count, rng, problem.margin) for name in names}
        found = {name: points for name, points in found.items() if len(points)}
        if directions := _directions(problem):
            told = {n: _told(directions, problem.body.evaluate(n, points)[2]) for n, points in found.items()}
            found = {name: points[told[name]] for name, points in found.items() if np.any(told[name])}
        for i in range(k):
            if not any(n in found for n in problem.allowed_faces(i)):
                raise InputError(
                    "GraspProblem.body", f"no point found on {problem.allowed_faces(i)}", "a reachable face"
                )
        return found

    def usable(self, contact: int) -> tuple[str, ...]:
        """Return the faces that a contact may use and that have points."""
        return tuple(n for n in self._problem.allowed_faces(contact) if n in self.faces)

    def cloud(self, contact: int) -> Cloud:
        """Return the points that a contact may use: of a mesh those of the mesh itself."""
        if isinstance(self._problem.body, Mesh):
            return self.mesh_cloud
        names = self.usable(contact)
        if names not in self._clouds:
            points = np.concatenate([self.faces[n] for n in names])
            labels = np.concatenate([np.full(len(self.faces[n]), n, dtype=object) for n in names])
            normals = np.concatenate([-self._problem.body.evaluate(n, self.faces[n])[2] for n in names])
            self._clouds[names] = Cloud(labels, points, normals, cKDTree(points))
        return self._clouds[names]

    @property
    def mesh(self) -> Mesh:
        """The body, which must be a mesh."""
        return mesh_of(self._problem)

    @cached_property
    def mesh_cloud(self) -> Cloud:
        """Points of the mesh itself, away from sharp edges, with its triangles' inward normals."""
        body = self.mesh
        points, normals = body.surface_samples(MESH_SAMPLES, np.random.default_rng(0))
        kept = plain(self._problem, points, normals)
        if kept.any():
            points, normals = points[kept], normals[kept]
        return Cloud(np.full(len(points), body.face_names[0], dtype=object), points, -normals, cKDTree(points))
