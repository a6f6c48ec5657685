"""Triangles of a mesh as faces of their own: the surfaces h_1(p) = 0 ... h_l(p) = 0 of the paper's (3.5-1)."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.face import Face
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray

NEAREST = 12  # sharp edges about a contact that its face keeps away from: it moves little


class Facets(Body):
    """The body of a mesh whose faces are the triangles that contacts are on: planes, with the edges as extents.

    Parameters
    ----------
    mesh : Mesh
    triangles : (k,) array of int
        Numbers of triangles of the mesh, one a contact.
    points : (n, k, 3) array
        Places of the contacts, metres.
    margin : float
        How far contacts stay from the sharp edges about their places, metres.

    Attributes
    ----------
    names : tuple of k str
        Of the contacts' faces, which ``triangle_of`` reads.
    """

    def __init__(self, mesh: Mesh, triangles: NDArray[np.intp], points: FloatArray, margin: float) -> None:
        self.mesh, self.margin = mesh, margin
        self.points, self.numbers = points, triangles
        self.names = tuple(f"contact {i}, triangle {number}" for i, number in enumerate(triangles.tolist()))

    @staticmethod
    def triangle_of(name: str) -> int:
        """Return the number of the triangle that a face of such a name is."""
        return int(name.rpartition(" ")[2])

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
        each = zip(self.names, self.points.transpose(1, 0, 2), self.numbers, strict=True)
        return tuple(self._face(name, places, corners[number], outward[number]) for name, places, number in each)

    def to_dict(self) -> Json:
        """Return the mesh as JSON data."""
        return self.mesh.to_dict()

    def _face(self, name: str, places: FloatArray, corners: FloatArray, outward: FloatArray) -> Face:
        beyond = np.cross(np.roll(corners, -1, axis=0) - corners, outward)
        lines = [(c, b / np.linalg.norm(b)) for c, b in zip(corners, beyond, strict=True) if np.any(b)]
        edges = np.zeros((0, 2, 3))
        if self.margin > 0.0:
            about = [self.mesh.sharp_edges(point, NEAREST) for point in places]
            edges = np.unique(np.concatenate(about).reshape(-1, 6), axis=0).reshape(-1, 2, 3)

        def surface(p: Expression) -> Expression:
            return ca.dot(ca.DM(outward), p - ca.DM(corners[0]))

        def extent(p: Expression) -> list[Expression]:
            own = [ca.dot(ca.DM(away), p - ca.DM(corner)) for corner, away in lines]
            return own + [-_distance(p, *map(ca.DM, ends)) for ends in edges]

        return Face(name, surface, extent, [False] * len(lines) + [True] * len(edges))


def _distance(p: Expression, start: ca.DM, end: ca.DM) -> Expression:
    """Return the distance of a CasADi point from a line segment."""
    along = end - start
    share = ca.fmin(ca.fmax(ca.dot(p - start, along) / ca.dot(along, along), 0.0), 1.0)
    return ca.norm_2(p - start - share * along)
