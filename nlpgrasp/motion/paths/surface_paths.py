"""Shortest paths over a body's surface, on a graph of sample points."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.paths.footpath import Station

SAMPLES, NEIGHBOURS = 3000, 14
OFF = 0.3  # share of an edge's length: largest distance of its middle from the surface


class SurfaceGraph:
    """Graph of surface samples, with edges between neighbours that stay near the surface.

    Parameters
    ----------
    body : Body
    """

    def __init__(self, body: Body) -> None:
        rng = np.random.default_rng(0)
        each = max(SAMPLES // len(body.faces), 60)
        samples = {name: body.sample(name, each, rng) for name in body.face_names}
        self.points = np.concatenate(list(samples.values()))
        self.normals = np.concatenate([-body.evaluate(name, p)[2] for name, p in samples.items()])
        self.faces = np.repeat(list(samples), [len(p) for p in samples.values()])
        self._tree: Any = cKDTree(self.points)
        found: Any = self._tree.query(self.points, NEIGHBOURS + 1)
        rows = np.repeat(np.arange(len(self.points)), NEIGHBOURS)
        lengths, columns = (part[:, 1:].ravel() for part in found)
        middle = (self.points[rows] + self.points[columns]) / 2.0
        off = np.abs(np.asarray(body.distance_function.map(len(middle))(middle.T).full()).ravel())
        good = off <= OFF * lengths
        shape = (len(self.points), len(self.points))
        self._edges: Any = sparse.csr_matrix((lengths[good], (rows[good], columns[good])), shape)

    def distances(self, start: FloatArray, ends: FloatArray) -> FloatArray:
        """Return the lengths of the shortest paths from a point to others, (m,), metres; inf without a path."""
        lengths = dijkstra(self._edges, False, self._nearest(start))
        return np.asarray(lengths[self._tree.query(ends)[1]])

    def stations(self, start: Station, end: Station) -> list[Station]:
        """Return the shortest path between two stations: these and the sample points between."""
        between = self._nodes(start.point, end.point)[1:-1]
        return [start, *(Station(self.points[i], self.normals[i], str(self.faces[i])) for i in between), end]

    def _nodes(self, start: FloatArray, end: FloatArray) -> list[int]:
        """Return the sample points of the path, those nearest to its ends included."""
        a, b = self._nearest(start), self._nearest(end)
        _, before = dijkstra(self._edges, False, a, True)
        nodes = [b]
        while nodes[-1] != a and before[nodes[-1]] >= 0:
            nodes.append(int(before[nodes[-1]]))
        return nodes[::-1] if len(nodes) > 1 else [a, b]

    def _nearest(self, p: FloatArray) -> Any:
        return self._tree.query(p)[1]
