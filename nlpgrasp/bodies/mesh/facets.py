"""Mesh body whose faces are the triangles that contacts lie on: the surfaces ``h_i(p) = 0`` of (3.5-1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from nlpgrasp.bodies.base import Body, Face
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, IntArray

SIDES = 3  # of a triangle
NEAREST, MOST = 12, 24  # sharp edges considered near a place of a contact; near all its places, at most


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

    def __init__(self, mesh: Mesh, triangles: IntArray, points: FloatArray, margin: float) -> None:
        self.mesh, self.margin = mesh, margin
        self.points, self.triangle_indices = points, triangles
        self.names = tuple(f"contact {i}, triangle {triangle}" for i, triangle in enumerate(triangles.tolist()))

    @staticmethod
    def triangle_of(name: str) -> int:
        """Return the triangle index that a face's name contains."""
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
        """Return the planar face of each contact's triangle."""
        return tuple(_facet_face(name, ca.DM(facet.geometry)) for name, facet in self._facets.items())

    def evaluate(
        self, name: str, points: FloatArray, margin: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Evaluate a face as ``Body.evaluate`` does, without a compiled function."""
        return self._facets[name].evaluate(points, margin)

    def to_dict(self) -> Json:
        """Return the mesh as JSON data."""
        return self.mesh.to_dict()

    def shared_surface(self, margin: float) -> ca.Function:
        """Return the function ``(p, geometry) -> (h, unit outward normal, limits)`` shared by all triangles."""
        return _shared_surface(len(self.geometry(self.names[0])), margin)

    def geometry(self, name: str) -> FloatArray:
        """Return plane, sides and nearby sharp edges of a contact's triangle, (q,), metres."""
        return self._facets[name].geometry

    @cached_property
    def _facets(self) -> dict[str, _Facet]:
        corners, outward = np.asarray(self.mesh.mesh.triangles), np.asarray(self.mesh.mesh.face_normals)
        contacts = zip(self.names, self.points.transpose(1, 0, 2), self.triangle_indices, strict=True)
        return {
            name: _Facet.of(corners[i], outward[i], self._sharp_edges(positions)) for name, positions, i in contacts
        }

    def _sharp_edges(self, positions: FloatArray) -> FloatArray:
        """Return the end points (e, 2, 3) of sharp edges near contact points (n, 3); empty if the margin is zero."""
        if self.margin == 0.0:
            return np.zeros((0, 2, 3))
        edges = np.concatenate([self.mesh.sharp_edges(point, NEAREST) for point in positions]).reshape(-1, 6)
        indices = np.sort(np.unique(edges, axis=0, return_index=True)[1])[:MOST]
        count = min(MOST, self.mesh.sharp_edge_count)
        return edges[np.resize(indices, count)].reshape(count, 2, 3)


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
        side_normals = np.cross(np.roll(corners, -1, axis=0) - corners, outward)
        length = np.linalg.norm(side_normals, axis=1)
        sides = np.resize(np.flatnonzero(length > 0.0), SIDES)  # a side without length is that of its neighbour
        return cls(outward, corners[sides], side_normals[sides] / length[sides, None], edges)

    @property
    def geometry(self) -> FloatArray:
        """Normal, corners, side normals and sharp edges of the facet in one vector, (q,)."""
        return np.concatenate([self.outward, self.corners.ravel(), self.away.ravel(), self.edges.ravel()])

    def evaluate(self, points: FloatArray, margin: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return h, gradient norm (one), unit outward normal and largest limit at points (m, 3)."""
        offsets = points[:, None] - self.corners
        limits = np.max(np.einsum("msi,si->ms", offsets, self.away), axis=1, initial=-np.inf)
        if len(self.edges) and margin > 0.0:
            directions = self.edges[:, 1] - self.edges[:, 0]
            position = np.einsum("mei,ei->me", points[:, None] - self.edges[:, 0], directions) / np.sum(
                directions**2, axis=1
            )
            nearest = self.edges[:, 0] + np.clip(position, 0.0, 1.0)[..., None] * directions
            distances = np.linalg.norm(points[:, None] - nearest, axis=2)
            limits = np.maximum(limits, margin - np.min(distances, axis=1))
        return offsets[:, 0] @ self.outward, np.ones(len(points)), np.tile(self.outward, (len(points), 1)), limits


@lru_cache
def _shared_surface(parameter_count: int, margin: float) -> ca.Function:
    """Return the compiled ``(p, geometry) -> (h, unit outward normal, limits)`` of a facet with q parameters."""
    p, q = ca.SX.sym("p", 3), ca.SX.sym("q", parameter_count)
    face = _facet_face("triangle", q)
    return ca.Function("triangle", [p, q], [face.surface(p), q[:3], ca.vertcat(*face.limits(p, margin))])


def _facet_face(name: str, geometry: Expression) -> Face:
    """Return the face, as CasADi expressions, of a facet with parameters ``geometry``, (q,)."""
    # as in ``_Facet.geometry``: normal, a corner of each side, normal of each side, both ends of each sharp edge
    outward, *vectors = ca.vertsplit(geometry, 3)
    corners, side_normals, ends = vectors[:SIDES], vectors[SIDES : 2 * SIDES], vectors[2 * SIDES :]

    def surface(p: Expression) -> Expression:
        return ca.dot(outward, p - corners[0])

    def extent(p: Expression) -> list[Expression]:
        return [ca.dot(a, p - c) for c, a in zip(corners, side_normals, strict=True)]

    def edges(p: Expression) -> list[Expression]:
        return [_segment_distance(p, *pair) for pair in zip(ends[::2], ends[1::2], strict=True)]

    return Face(name, surface, extent, [False] * SIDES, edges=edges)


def _segment_distance(p: Expression, start: Expression, end: Expression) -> Expression:
    """Return the distance of a CasADi point from a line segment."""
    direction = end - start
    position = ca.fmin(ca.fmax(ca.dot(p - start, direction) / ca.dot(direction, direction), 0.0), 1.0)
    return ca.norm_2(p - start - position * direction)
