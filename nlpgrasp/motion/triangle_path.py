"""Path of a contact over the triangles of a mesh, along planes through the stations of a path over its smooth surface.

Between two stations the path is the intersection of the triangles with the plane through both stations and along their
normals. It is straight on each triangle, and at an edge the normal turns from that of one triangle to that of the next,
so that bounds on a quality along it have no deviations of a curved surface to allow for.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from nlpgrasp.bodies.mesh import Mesh
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.quality.sliding_contact import SurfacePath

NONE = -1  # no triangle beyond a side, or more than one
LONGEST = 4.0  # longest path between two stations over their distance, beyond which none is taken
SIDES = ((0, 1), (1, 2), (2, 0))  # corners of a triangle at the ends of its sides


class TrianglePaths:
    """Paths of contacts over the triangles of a mesh.

    Parameters
    ----------
    body : Mesh
    """

    def __init__(self, body: Mesh) -> None:
        self.body = body
        self._vertices = np.asarray(body.mesh.vertices, dtype=float)
        self._faces = np.asarray(body.mesh.faces)
        self._inward = -np.asarray(body.mesh.face_normals)

    @cached_property
    def _neighbours(self) -> IntArray:
        """Triangle beyond each side of each triangle, (f, 3), or ``NONE``."""
        sides = np.sort(self._faces[:, SIDES].reshape(-1, 2), axis=1)
        _, edge, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(edge.ravel(), kind="stable")
        pairs = order[np.repeat(count == 2, count)].reshape(-1, 2)
        neighbours = np.full(len(sides), NONE)
        neighbours[pairs] = pairs[:, ::-1] // 3
        return neighbours.reshape(-1, 3)

    def over(self, points: FloatArray, normals: FloatArray) -> SurfacePath:
        """Return the path over the triangles through the points of the mesh nearest to stations.

        It begins and ends with the first and the last station themselves. Where the planes lead from a station to no
        triangle of the next one, the deviation from the chord is infinite.

        Parameters
        ----------
        points, normals : (m, 3) arrays
            Metres; inward unit normals.
        """
        nearest = self.body.closest(points)[0]
        triangles = self.body.triangles_at(points)
        path, normal, deviations = [points[0]], [normals[0]], [0.0]
        for i, j in itertools.pairwise(range(len(points))):
            path.append(nearest[i])
            normal.append(self._inward[triangles[i]])
            crossings = self._crossings(nearest[[i, j]], triangles[[i, j]], normals[i] + normals[j])
            for point, (before, after) in crossings or ():
                path += [point, point]
                normal += [self._inward[before], self._inward[after]]
                deviations += [0.0, 0.0]
            deviations += [np.inf if crossings is None else 0.0, 0.0]
            path.append(nearest[j])
            normal.append(self._inward[triangles[j]])
        path.append(points[-1])
        normal.append(normals[-1])
        return SurfacePath(np.array(path), np.array(normal), np.column_stack([deviations, np.zeros(len(deviations))]))

    def _crossings(
        self, ends: FloatArray, triangles: IntArray, along: FloatArray
    ) -> list[tuple[FloatArray, tuple[int, int]]] | None:
        """Return the points where the shortest path between two points, (2, 3), crosses edges, with both triangles.

        The path is in the plane of both points and a direction. None where that plane does not connect them.
        """
        first, last = triangles.tolist()
        if first == last:
            return []
        chord = ends[1] - ends[0]
        plane, longest = np.cross(chord, along), LONGEST * float(np.linalg.norm(chord))
        paths = [path for side in range(3) if (path := self._walk(ends, first, last, plane, side, longest)) is not None]
        return min(paths, key=lambda path: path[0])[1] if paths else None

    def _walk(
        self, ends: FloatArray, first: int, last: int, plane: FloatArray, side: int, longest: float
    ) -> tuple[float, list[tuple[FloatArray, tuple[int, int]]]] | None:
        """Return length and crossings of the walk in a plane that leaves the first triangle over a side.

        None if the plane does not cross that side, or the walk is too long before it reaches the last triangle.
        """
        crossings, length, position = list[tuple[FloatArray, tuple[int, int]]](), 0.0, ends[0]
        for point, pair in self._steps(ends[0], plane, first, side):
            length += float(np.linalg.norm(point - position))
            position = point
            crossings.append((point, pair))
            if pair[1] == last:
                return length + float(np.linalg.norm(ends[1] - point)), crossings
            if length > longest:
                break
        return None

    def _steps(
        self, origin: FloatArray, plane: FloatArray, triangle: int, side: int
    ) -> Iterator[tuple[FloatArray, tuple[int, int]]]:
        """Yield the crossings of edges by a plane, from a triangle over one of its sides onwards."""
        entered = NONE
        while True:
            heights = (self._vertices[self._faces[triangle]] - origin) @ plane
            is_above = heights >= 0.0
            following = self._neighbours[triangle]
            sides = [side] if entered == NONE else [s for s in range(3) if following[s] != entered]
            crossed = [s for s in sides if is_above[SIDES[s][0]] != is_above[SIDES[s][1]] and following[s] != NONE]
            if not crossed:
                return
            i, j = SIDES[crossed[0]]
            fraction = heights[i] / (heights[i] - heights[j])
            corners = self._vertices[self._faces[triangle][[i, j]]]
            entered, triangle = triangle, int(following[crossed[0]])
            yield corners[0] + fraction * (corners[1] - corners[0]), (entered, triangle)
