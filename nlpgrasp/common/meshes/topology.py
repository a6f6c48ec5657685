"""Topology of triangle meshes: merged vertices, connected parts, orientation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from nlpgrasp.common.meshes.search_tree import OPEN_SHARE, SearchTree, unclear_fraction
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh


FLAT = 1e-9  # of the bounding box's volume: volume below which a part is a sheet
NEGLIGIBLE = 1e-4  # of the surface area: share of opposite triangle pairs that is tolerated
TESTED_VERTICES = 16  # vertices of a part tested for being inside another
LEAST_SOLID = 3  # triangles: fewer enclose no volume, with a hole of one triangle
SEAM = 1e-6  # of the longest side: distance within which open edges merge (exporters use single precision)


@dataclass(frozen=True)
class MeshParts:
    """Mesh with its parts that are connected through edges.

    Where more than two triangles share an edge, consecutive ones in the mesh belong together, since files contain one
    part after the other.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres.
    faces : (f, 3) int array
    """

    vertices: FloatArray
    faces: IntArray

    @cached_property
    def _edges(self) -> IntArray:
        """Index of each undirected edge of each triangle, (f, 3)."""
        ends = np.sort(np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=2), axis=2)
        keys = ends[..., 0] * np.int64(len(self.vertices)) + ends[..., 1]
        return np.asarray(np.unique(keys, return_inverse=True)[1]).reshape(self.faces.shape)

    @cached_property
    def _edge_directions(self) -> IntArray:
        """Direction of each edge in its triangle, (f, 3): 1 from the smaller vertex index, -1 from the larger."""
        return np.where(self.faces < np.roll(self.faces, -1, axis=1), 1, -1)

    @cached_property
    def open_edges(self) -> int:
        """Number of open edges: edges with unequal numbers of triangles in both directions."""
        return int(np.count_nonzero(np.bincount(self._edges.ravel(), self._edge_directions.ravel())))

    @cached_property
    def open_vertices(self) -> IntArray:
        """Indices of the vertices of open edges."""
        sums = np.bincount(self._edges.ravel(), self._edge_directions.ravel())
        is_open = sums[self._edges] != 0
        return np.unique([self.faces[is_open], np.roll(self.faces, -1, axis=1)[is_open]]).astype(np.int64)

    @cached_property
    def labels(self) -> IntArray:
        """Part index of each triangle, (f,)."""
        edges, directions = self._edges.ravel(), self._edge_directions.ravel()
        order = np.argsort(edges, kind="stable")
        starts = np.flatnonzero(np.diff(edges[order], prepend=-1))
        rank = np.arange(len(edges)) - np.repeat(starts, np.diff(starts, append=len(edges)))  # among those of its edge
        first, second = order[:-1], order[1:]
        is_adjacent = (edges[first] == edges[second]) & (rank[:-1] % 2 == 0) & (directions[first] != directions[second])
        first, second, count = first[is_adjacent] // 3, second[is_adjacent] // 3, len(self.faces)
        graph = coo_matrix((np.ones(len(first), dtype=bool), (first, second)), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)

    @cached_property
    def volumes(self) -> FloatArray:
        """Signed volume of each part, about the mean vertex of the mesh, m^3."""
        a, b, c = (self.vertices[self.faces[:, i]] - self.vertices.mean(axis=0) for i in range(3))
        return np.asarray(np.bincount(self.labels, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0))

    @cached_property
    def closed(self) -> IntArray:
        """Indices of the parts without open edges."""
        edges, directions = self._edges, self._edge_directions
        count = edges.max() + 1
        keys, key = np.unique((self.labels[:, None] * count + edges).ravel(), return_inverse=True)
        is_closed = np.ones(len(self.volumes), dtype=bool)
        is_closed[keys[np.bincount(np.asarray(key).ravel(), directions.ravel()) != 0] // count] = False
        return np.flatnonzero(is_closed)

    @cached_property
    def solid(self) -> IntArray:
        """Indices of the parts that have a volume and no open edges."""
        box = float(np.prod(np.ptp(self.vertices, axis=0)))
        return self.closed[np.abs(self.volumes[self.closed]) > FLAT * box]

    @cached_property
    def _order(self) -> tuple[IntArray, IntArray]:
        """Triangle indices sorted by part, and the first position of each part."""
        order = np.argsort(self.labels, kind="stable")
        return order, np.searchsorted(self.labels[order], np.arange(len(self.volumes) + 1))

    def mesh_of(self, part: int) -> tuple[FloatArray, IntArray]:
        """Return the vertices (v, 3) and triangles (f, 3) of a single part."""
        order, starts = self._order
        return drop_unused_vertices(self.vertices, self.faces[order[starts[part] : starts[part + 1]]])

    def boxes(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper corners of the parts' bounding boxes, (p, 3) each."""
        order, starts = self._order
        corners = self.vertices[self.faces[order]]
        lower = np.minimum.reduceat(corners.min(axis=1), starts[:-1], axis=0)
        return lower, np.maximum.reduceat(corners.max(axis=1), starts[:-1], axis=0)

    def cavities(self) -> IntArray:
        """Return the indices of the solid parts that bound cavities.

        They are inside other parts and have the opposite orientation.
        """
        signs = np.sign(self.volumes)
        if len(signs) < 2 or np.all(signs[self.solid] == signs[self.solid[:1]]):
            return np.zeros(0, dtype=np.int64)
        lower, upper = self.boxes()
        tree_of = cache(lambda part: SearchTree(*self.mesh_of(part)))
        cavities = []
        for part in self.solid:
            enclosing = [
                candidate
                for candidate in self.solid
                if candidate != part
                and np.all(lower[candidate] <= lower[part])
                and np.all(upper[part] <= upper[candidate])
            ]
            corners = self.mesh_of(part)[0][:: max(1, self._size(part) // TESTED_VERTICES)]
            containers = [
                candidate
                for candidate in enclosing
                if np.all(np.abs(tree_of(candidate).winding_numbers(corners)) > 0.5)
            ]
            orientation = sum(signs[candidate] for candidate in containers)
            if abs(orientation + signs[part]) < abs(orientation):
                cavities.append(part)
        return np.array(cavities, dtype=np.int64)

    def _size(self, part: int) -> int:
        starts = self._order[1]
        return int(starts[part + 1] - starts[part])


def drop_unused_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the vertices (v, 3) that triangles use, and the triangles (f, 3) with new vertex indices."""
    indices, new_indices = np.unique(faces, return_inverse=True)
    return vertices[indices], np.asarray(new_indices).reshape(-1, 3).astype(np.int64)


def drop_duplicates(vertices: FloatArray, faces: IntArray) -> tuple[BoolArray, int, int]:
    """Return the mask (f,) of triangles to keep, and the numbers of dropped copies and dropped opposite triangles.

    Pairs of opposite triangles bound no volume. They are dropped unless their area is negligible. Where the rest is
    open without them, the triangle of a pair that closes it stays. Of a connected part that consists of such pairs
    alone, a surface drawn from both sides, one side stays if it has an inside.
    """
    ordered = np.argsort(faces, axis=1, kind="stable")
    orientation = np.where(
        np.isin(ordered @ np.array([9, 3, 1]), (5, 15, 19)), 1, -1
    )  # 012, 120, 201: even permutations
    _, group = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    group = np.asarray(group).ravel()
    net = np.bincount(group, orientation)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    balanced = net[group] == 0
    if area[balanced].sum() <= NEGLIGIBLE * area.sum():
        balanced[:] = False
    first = np.full(len(net), len(faces), dtype=np.int64)
    candidates = np.flatnonzero((net[group] == 0) | (orientation == np.sign(net[group])))
    np.minimum.at(first, group[candidates], candidates)
    is_first = first[group] == np.arange(len(faces))
    copies = (net[group] != 0) & ~is_first
    sides = _one_side_of_double(vertices, faces, balanced, is_first)
    closing = sides | _closing_triangles(faces, group, ~(copies | balanced), balanced)
    is_kept = ~(copies | balanced) | closing
    if not np.any(is_kept):
        return ~is_kept, 0, 0
    return is_kept, int(copies.sum()), int((balanced & ~closing).sum())


def _one_side_of_double(vertices: FloatArray, faces: IntArray, balanced: BoolArray, is_first: BoolArray) -> BoolArray:
    """Return the mask (f,) of one triangle of each pair of connected parts of pairs alone, where these have an inside.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    balanced : (f,) array
        Whether as many triangles with the same vertices face one way as the other.
    is_first : (f,) array
        Whether a triangle is the one of its group that may stay.
    """
    import trimesh

    result = np.zeros(len(faces), dtype=bool)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2) @ np.array([faces.max() + 1, 1])
    edges = np.unique(ends, return_inverse=True)[1].reshape(-1)
    owners = np.repeat(np.arange(len(faces)), 3)
    count = len(faces) + int(edges.max()) + 1
    graph = coo_matrix((np.ones(len(edges), dtype=bool), (owners, len(faces) + edges)), shape=(count, count))
    part = connected_components(graph, directed=False)[1][: len(faces)]
    candidates = np.flatnonzero(is_first & ~np.isin(part, part[~balanced]))
    candidates = candidates[np.argsort(part[candidates], kind="stable")]
    for chosen in np.split(candidates, np.flatnonzero(np.diff(part[candidates])) + 1):
        if len(chosen) < LEAST_SOLID:
            continue
        side = trimesh.Trimesh(*drop_unused_vertices(vertices, faces[chosen]), process=False)
        side.fill_holes()
        trimesh.repair.fix_normals(side)
        closed = MeshParts(np.asarray(side.vertices), np.asarray(side.faces))
        has_volume = abs(closed.volumes.sum()) > FLAT * float(np.prod(np.ptp(side.vertices, axis=0)))
        if has_volume and (not closed.open_edges or unclear_fraction(closed.vertices, closed.faces) <= OPEN_SHARE):
            result[chosen] = True
    return result


def _closing_triangles(faces: IntArray, group: IntArray, is_kept: BoolArray, pairs: BoolArray) -> BoolArray:
    """Return the mask (f,) of triangles, at most one of opposite ones, that close the surface of the kept triangles.

    A group has the same three vertices, and at most one triangle of it is chosen. An open edge with a single group of
    undecided triangles decides that group, then the other edges of the chosen triangle are examined.
    """
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    keys = np.sort(ends, axis=2) @ np.array([faces.max() + 1, 1])
    edges = np.unique(keys, return_inverse=True)[1].reshape(keys.shape)
    directions = np.where(ends[..., 0] < ends[..., 1], 1, -1)
    count = edges.max() + 1
    undecided, closing = pairs.copy(), np.zeros(len(faces), dtype=bool)
    members = np.maximum(np.bincount(group, pairs), 1.0)[group]
    while True:
        imbalance = np.bincount(edges[is_kept | closing].ravel(), directions[is_kept | closing].ravel(), count)
        groups = np.bincount(edges[undecided].ravel(), np.repeat(1.0 / members[undecided], 3), count)
        is_fitting = (imbalance[edges] == -directions) & (np.abs(groups[edges] - 1.0) < 0.5) & undecided[:, None]
        is_contrary = (imbalance[edges] == directions) & (np.abs(groups[edges] - 1.0) < 0.5)
        chosen = np.flatnonzero(is_fitting.any(axis=1) & ~is_contrary.any(axis=1))
        if not len(chosen):
            return closing
        chosen = chosen[np.unique(group[chosen], return_index=True)[1]]
        closing[chosen] = True
        undecided &= ~np.isin(group, group[chosen])


def merge_mesh_vertices(vertices: FloatArray, faces: IntArray) -> trimesh.Trimesh:
    """Return the mesh with one vertex for each position, without degenerate triangles.

    Vertices merge within 1e-8 m. If edges stay open, vertices of open edges merge within a millionth of the longest
    side, and thin triangles that close a gap are kept; the result with the fewest open edges is returned.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres.
    faces : (f, 3) int array
    """
    import trimesh

    merged = trimesh.Trimesh(vertices, faces, process=False)
    merged.merge_vertices()
    result = merged.copy()
    result.update_faces(result.nondegenerate_faces())
    if not len(result.faces) or is_plain(result):  # watertight, with consistent winding
        return result
    fewest = count_open_edges(result)
    if not fewest:
        return result
    all_faces = np.asarray(merged.faces)
    distinct = all_faces[_has_three_corners(all_faces)]
    for candidate in (distinct, weld_faces(np.asarray(merged.vertices), distinct)):
        open_edges = MeshParts(np.asarray(merged.vertices), candidate).open_edges if len(candidate) else fewest
        if open_edges < fewest:
            fewest, result = open_edges, trimesh.Trimesh(merged.vertices, candidate, process=False)
            result.remove_unreferenced_vertices()
    return result


def weld_faces(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the triangles (f, 3) after vertices of open edges closer than ``SEAM`` are merged."""
    open_vertices = MeshParts(vertices, faces).open_vertices
    radius = SEAM * float(np.max(np.ptp(vertices, axis=0)))
    pairs = open_vertices[cKDTree(vertices[open_vertices]).query_pairs(radius, output_type="ndarray")]
    count = len(vertices)
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    first = np.full(count, count, dtype=np.int64)
    np.minimum.at(first, labels, np.arange(count))
    result = first[labels][faces]
    return np.asarray(result[_has_three_corners(result)])


def is_plain(mesh: trimesh.Trimesh) -> bool:
    """Return whether a mesh is watertight with consistent winding."""
    return bool(mesh.is_watertight and mesh.is_winding_consistent)


def count_open_edges(mesh: trimesh.Trimesh) -> int:
    """Return the number of a mesh's open edges, as ``MeshParts.open_edges``."""
    return MeshParts(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)).open_edges


def _has_three_corners(faces: IntArray) -> BoolArray:
    """Return whether each triangle (f, 3) has three distinct vertices, (f,)."""
    return np.asarray(np.all(faces != np.roll(faces, 1, axis=1), axis=1))
