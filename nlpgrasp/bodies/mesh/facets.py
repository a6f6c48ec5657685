"""Triangles of a mesh as faces of their own: the surfaces h_1(p) = 0 ... h_l(p) = 0 of the paper's (3.5-1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.face import Face
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray


class Facets(Body):
    """The body of a mesh whose faces are the triangles that contacts are on: planes, with the edges as extents.

    Parameters
    ----------
    mesh : Mesh
    triangles : (k,) array of int
        Numbers of triangles of the mesh, one a contact.
    points : (k, 3) array
        A point of each, metres.
    margin : float
        How far the points are from sharp edges, metres: faces keep that distance to first order about their point.

    Attributes
    ----------
    names : tuple of k str
        Of the contacts' faces, which ``triangles_of`` reads.
    """

    def __init__(self, mesh: Mesh, triangles: NDArray[np.intp], points: FloatArray, margin: float) -> None:
        self.mesh, self.margin = mesh, margin
        self.points, self.numbers = points, triangles
        self.names = tuple(f"contact {i}, triangle {number}" for i, number in enumerate(triangles.tolist()))

    @staticmethod
    def triangles_of(names: Sequence[str]) -> NDArray[np.intp]:
        """Return the numbers of the triangles that faces of such names are, (k,)."""
        return np.array([int(name.rpartition(" ")[2]) for name in names], dtype=np.intp)

    @property
    def bounds(self) -> FloatArray:
        """Bounding box of the mesh, (2, 3), metres."""
        return self.mesh.bounds

    @property
    def centroid(self) -> FloatArray:
        """Centre of volume of the mesh, (3,), metres."""
        return self.mesh.centroid

    @cached_property
    def distance_function(self) -> ca.Function:
        """The mesh's own: from a point (3,) to metres."""
        return self.mesh.distance_function

    def make_faces(self) -> tuple[Face, ...]:
        """Return a face for each contact."""
        corners, outward = np.asarray(self.mesh.mesh.triangles), np.asarray(self.mesh.mesh.face_normals)
        each = zip(self.names, self.points, self.numbers, strict=True)
        return tuple(self._face(name, point, corners[number], outward[number]) for name, point, number in each)

    def to_dict(self) -> Json:
        """Return the mesh as JSON data."""
        return self.mesh.to_dict()

    def _face(self, name: str, point: FloatArray, corners: FloatArray, outward: FloatArray) -> Face:
        edges = np.roll(corners, -1, axis=0) - corners
        beyond = np.cross(edges, outward)
        lines = [(c, b / np.linalg.norm(b)) for c, b in zip(corners, beyond, strict=True) if np.any(b)]
        sharp = [False] * len(lines)
        if self.margin > 0.0:
            reach = self.margin + float(np.max(np.linalg.norm(corners - point, axis=1)))
            for nearest in self.mesh.sharp_points(point, reach):
                lines.append((nearest, (nearest - point) / np.linalg.norm(nearest - point)))
                sharp.append(True)

        def surface(p: Expression) -> Expression:
            return ca.dot(ca.DM(outward), p - ca.DM(point))

        return Face(name, surface, _beyond(lines), sharp)


def _beyond(lines: Sequence[tuple[FloatArray, FloatArray]]) -> Callable[[Expression], Sequence[Expression]]:
    """Return what says how far a CasADi point is beyond lines, each a point and the direction away from the face."""
    return lambda p: [ca.dot(ca.DM(away), p - ca.DM(point)) for point, away in lines]
