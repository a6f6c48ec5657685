"""Mesh body whose faces are the triangles or smooth patches that contacts lie on: ``h_i(p) = 0`` of (3.5-1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    """A mesh body with one face per contact: the triangle that it lies on, or a patch of the smoothed surface.

    Parameters
    ----------
    mesh : Mesh
    triangles : (k,) array of int
        Indices of triangles of the mesh, one per contact.
    points : (n, k, 3) array
        Contact points, metres.
    margin : float
        Least distance of contacts from nearby sharp edges, metres.
    patches : SmoothPatches, optional
        Faces in place of the triangles.

    Attributes
    ----------
    names : tuple of k str
        Of the contacts' faces; ``triangle_of`` returns their triangles.
    """

    def __init__(
        self, mesh: Mesh, triangles: IntArray, points: FloatArray, margin: float, patches: SmoothPatches | None = None
    ) -> None:
        self.mesh, self.margin, self._patches = mesh, margin, patches
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
        edges = [self._sharp_edges(positions) for positions in self.points.transpose(1, 0, 2)]
        if self._patches is not None:
            facets = [replace(patch, edges=near) for patch, near in zip(self._patches.facets(), edges, strict=True)]
        else:
            triangles = zip(self.triangle_indices, edges, strict=True)
            facets = [_Facet.of(corners[i], outward[i], near) for i, near in triangles]
        return dict(zip(self.names, facets, strict=True))

    def _sharp_edges(self, positions: FloatArray) -> FloatArray:
        """Return the end points (e, 2, 3) of sharp edges near contact points (n, 3); empty if the margin is zero."""
        if self.margin == 0.0:
            return np.zeros((0, 2, 3))
        edges = np.concatenate([self.mesh.sharp_edges(point, NEAREST) for point in positions]).reshape(-1, 6)
        indices = np.sort(np.unique(edges, axis=0, return_index=True)[1])[:MOST]
        count = min(MOST, self.mesh.sharp_edge_count)
        return edges[np.resize(indices, count)].reshape(count, 2, 3)


@dataclass(frozen=True)
class SmoothPatches:
    """Second-order patches of a mesh's smoothed surface, one per contact.

    Parameters
    ----------
    points, outward : (k, 3) arrays
        On the surface, metres, and unit normals there.
    curvatures : (k, 3, 3) array
        Second derivatives of the distance over its slope, 1/m.
    reach : float
        Distance to which a patch extends, metres.
    """

    points: FloatArray
    outward: FloatArray
    curvatures: FloatArray
    reach: float

    def facets(self) -> list[_Facet]:
        """Return the patches as faces without sharp edges."""
        patches = zip(self.points, self.outward, self.curvatures, strict=True)
        return [_Facet.of_patch(*patch, self.reach) for patch in patches]


@dataclass(frozen=True)
class _Facet:
    """A triangle, or a patch of the smoothed surface, with the nearby sharp edges of the mesh.

    The face is ``n (p - c) + (p - c) S (p - c) / 2 = 0`` with a curvature S that is zero for a triangle.

    Parameters
    ----------
    outward : (3,) array
        Unit normal n at the point.
    point : (3,) array
        c, metres.
    curvature : (3, 3) array
        S, symmetric, 1/m.
    corners, away : (m, 3) array
        A point on each side, metres, and that side's outward unit normal in the plane.
    edges : (e, 2, 3) array
        Ends of sharp edges, metres.
    """

    outward: FloatArray
    point: FloatArray
    curvature: FloatArray
    corners: FloatArray
    away: FloatArray
    edges: FloatArray

    @classmethod
    def of(cls, corners: FloatArray, outward: FloatArray, edges: FloatArray) -> _Facet:
        """Return the facet of a triangle with corners (3, 3), metres, and an outward normal (3,)."""
        side_normals = np.cross(np.roll(corners, -1, axis=0) - corners, outward)
        length = np.linalg.norm(side_normals, axis=1)
        sides = np.resize(np.flatnonzero(length > 0.0), SIDES)  # a side without length is that of its neighbour
        flat = np.zeros((3, 3))
        return cls(outward, corners[sides][0], flat, corners[sides], side_normals[sides] / length[sides, None], edges)

    @classmethod
    def of_patch(cls, point: FloatArray, outward: FloatArray, curvature: FloatArray, reach: float) -> _Facet:
        """Return a patch about a point, which ends at a distance ``reach`` on three sides, metres."""
        beside = np.cross(outward, np.eye(3)[np.argmin(np.abs(outward))])
        beside /= np.linalg.norm(beside)
        turns = 2.0 * np.pi / SIDES * np.arange(SIDES)[:, None]
        away = np.cos(turns) * beside + np.sin(turns) * np.cross(outward, beside)
        return cls(outward, point, curvature, point + reach * away, away, np.zeros((0, 2, 3)))

    @property
    def geometry(self) -> FloatArray:
        """Normal, point, curvature, sides and sharp edges of the facet in one vector, (q,)."""
        rows, columns = np.triu_indices(3)
        parts = self.outward, self.point, self.curvature[rows, columns], self.corners, self.away, self.edges
        return np.concatenate([part.ravel() for part in parts])

    def evaluate(self, points: FloatArray, margin: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return h, gradient norm, unit outward normal and largest limit at points (m, 3)."""
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
        d = points - self.point
        bent = d @ self.curvature
        normals = self.outward + bent
        slopes = np.linalg.norm(normals, axis=1)
        return d @ self.outward + 0.5 * np.sum(d * bent, axis=1), slopes, normals / slopes[:, None], limits


@lru_cache
def _shared_surface(parameter_count: int, margin: float) -> ca.Function:
    """Return the compiled ``(p, geometry) -> (h, unit outward normal, limits)`` of a facet with q parameters."""
    p, q = ca.SX.sym("p", 3), ca.SX.sym("q", parameter_count)
    face = _facet_face("triangle", q)
    h = face.surface(p)
    slope = ca.gradient(h, p)
    return ca.Function("triangle", [p, q], [h, slope / ca.norm_2(slope), ca.vertcat(*face.limits(p, margin))])


def _facet_face(name: str, geometry: Expression) -> Face:
    """Return the face, as CasADi expressions, of a facet with parameters ``geometry``, (q,)."""
    # as in ``_Facet.geometry``
    outward, point, *vectors = ca.vertsplit(geometry, 3)
    xx, xy, xz, yy, yz, zz = ca.vertsplit(geometry[6:12])
    curvature = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    vectors = vectors[2:]
    corners, side_normals, ends = vectors[:SIDES], vectors[SIDES : 2 * SIDES], vectors[2 * SIDES :]

    def surface(p: Expression) -> Expression:
        return ca.dot(outward, p - point) + 0.5 * ca.dot(p - point, ca.mtimes(curvature, p - point))

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
