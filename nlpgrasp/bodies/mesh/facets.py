"""Triangles of a mesh as planar faces, the surfaces ``h_1(p) = 0 ... h_l(p) = 0`` of (3.5-1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.face import Face
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray

NEAREST = 12  # sharp edges considered near a contact


class Facets(Body):
    """A mesh body with one planar face per contact: the triangle that the contact lies on.

    Parameters
    ----------
    mesh : Mesh
    triangles : (k,) array of int
        Indices of triangles of the mesh, one per contact.
    points : (n, k, 3) array
        Contact points, metres.
    margin : float
        Least distance of contacts from nearby sharp edges, metres.

    Attributes
    ----------
    names : tuple of k str
        Of the contacts' faces; ``triangle_of`` returns their triangles.
    """

    def __init__(self, mesh: Mesh, triangles: NDArray[np.intp], points: FloatArray, margin: float) -> None:
        self.mesh, self.margin = mesh, margin
        self.points, self.numbers = points, triangles
        self.names = tuple(f"contact {i}, triangle {number}" for i, number in enumerate(triangles.tolist()))

    @staticmethod
    def triangle_of(name: str) -> int:
        """Return the triangle index in a face's name."""
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
        """Compiled signed distance of the mesh: a function of a point (3,), in metres."""
        return self.mesh.distance_function

    def make_faces(self) -> tuple[Face, ...]:
        """Return a face for each contact."""
        return tuple(facet.face(name) for name, facet in self._facets.items())

    def evaluate(
        self, name: str, points: FloatArray, margin: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return height, ones, outward normals and largest extent, as ``Body.evaluate``, without compilation."""
        return self._facets[name].evaluate(points, margin)

    def to_dict(self) -> Json:
        """Return the mesh as JSON data."""
        return self.mesh.to_dict()

    @cached_property
    def _facets(self) -> dict[str, _Facet]:
        corners, outward = np.asarray(self.mesh.mesh.triangles), np.asarray(self.mesh.mesh.face_normals)
        each = zip(self.names, self.points.transpose(1, 0, 2), self.numbers, strict=True)
        return {name: _Facet.of(corners[i], outward[i], self._sharp_edges(places)) for name, places, i in each}

    def _sharp_edges(self, places: FloatArray) -> FloatArray:
        """Return the end points (e, 2, 3) of sharp edges near contact points (n, 3); none if the margin is zero."""
        if self.margin == 0.0:
            return np.zeros((0, 2, 3))
        about = [self.mesh.sharp_edges(point, NEAREST) for point in places]
        return np.unique(np.concatenate(about).reshape(-1, 6), axis=0).reshape(-1, 2, 3)


@dataclass(frozen=True)
class _Facet:
    """A triangle: its plane, its sides, and the nearby sharp edges of the mesh.

    Parameters
    ----------
    outward : (3,) array
        Unit normal.
    corners, away : (m, 3) array
        A corner on each side, metres, and that side's outward unit normal in the plane.
    edges : (e, 2, 3) array
        Ends of sharp edges, metres.
    """

    outward: FloatArray
    corners: FloatArray
    away: FloatArray
    edges: FloatArray

    @classmethod
    def of(cls, corners: FloatArray, outward: FloatArray, edges: FloatArray) -> _Facet:
        """Return the facet of a triangle with corners (3, 3), metres, and an outward normal (3,)."""
        away = np.cross(np.roll(corners, -1, axis=0) - corners, outward)
        length = np.linalg.norm(away, axis=1)
        return cls(outward, corners[length > 0.0], away[length > 0.0] / length[length > 0.0, None], edges)

    def face(self, name: str) -> Face:
        """Return the facet as a face of CasADi expressions."""
        outward, corner = ca.DM(self.outward), ca.DM(self.corners[0])
        sides = [(ca.DM(c), ca.DM(a)) for c, a in zip(self.corners, self.away, strict=True)]

        def surface(p: Expression) -> Expression:
            return ca.dot(outward, p - corner)

        def extent(p: Expression) -> list[Expression]:
            return [ca.dot(a, p - c) for c, a in sides]

        def edges(p: Expression) -> list[Expression]:
            return [_distance(p, *map(ca.DM, ends)) for ends in self.edges]

        return Face(name, surface, extent, [False] * len(sides), edges=edges)

    def evaluate(self, points: FloatArray, margin: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return height over the plane, ones, unit outward normals and largest extent at points (m, 3)."""
        arms = points[:, None] - self.corners
        beyond = np.max(np.einsum("msi,si->ms", arms, self.away), axis=1, initial=-np.inf)
        if len(self.edges) and margin > 0.0:
            along = self.edges[:, 1] - self.edges[:, 0]
            share = np.einsum("mei,ei->me", points[:, None] - self.edges[:, 0], along) / np.sum(along**2, axis=1)
            nearest = self.edges[:, 0] + np.clip(share, 0.0, 1.0)[..., None] * along
            apart = np.linalg.norm(points[:, None] - nearest, axis=2)
            beyond = np.maximum(beyond, margin - np.min(apart, axis=1))
        return arms[:, 0] @ self.outward, np.ones(len(points)), np.tile(self.outward, (len(points), 1)), beyond


def _distance(p: Expression, start: ca.DM, end: ca.DM) -> Expression:
    """Return the distance of a CasADi point from a line segment."""
    along = end - start
    share = ca.fmin(ca.fmax(ca.dot(p - start, along) / ca.dot(along, along), 0.0), 1.0)
    return ca.norm_2(p - start - share * along)
