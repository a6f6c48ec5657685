"""Merging of mesh vertices by position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from nlpgrasp.common.meshes.parts import Parts
from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh

SEAM = 1e-6  # of the longest side: distance within which open edges merge (exporters use single precision)


def merged_mesh(vertices: FloatArray, faces: IntArray) -> trimesh.Trimesh:
    """Return the mesh with one vertex per position and without degenerate triangles.

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
    if not len(result.faces) or is_plain(result) or not (fewest := open_edges(result)):
        return result
    all_faces = np.asarray(merged.faces)
    proper = all_faces[_has_three_corners(all_faces)]
    for candidate in (proper, welded_faces(np.asarray(merged.vertices), proper)):
        left = Parts(np.asarray(merged.vertices), candidate).open_edges if len(candidate) else fewest
        if left < fewest:
            fewest, result = left, trimesh.Trimesh(merged.vertices, candidate, process=False)
            result.remove_unreferenced_vertices()
    return result


def welded_faces(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the triangles (f, 3) with vertices of open edges merged within ``SEAM``."""
    loose = Parts(vertices, faces).open_vertices
    reach = SEAM * float(np.max(np.ptp(vertices, axis=0)))
    pairs = loose[cKDTree(vertices[loose]).query_pairs(reach, output_type="ndarray")]
    count = len(vertices)
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    first = np.full(count, count, dtype=np.int64)
    np.minimum.at(first, labels, np.arange(count))
    result = first[labels][faces]
    return np.asarray(result[_has_three_corners(result)])


def is_plain(mesh: trimesh.Trimesh) -> bool:
    """Return whether the mesh is watertight with consistent winding."""
    return bool(mesh.is_watertight and mesh.is_winding_consistent)


def open_edges(mesh: trimesh.Trimesh) -> int:
    """Return the number of open edges, used unequally often in both directions."""
    return Parts(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)).open_edges


def _has_three_corners(faces: IntArray) -> NDArray[np.bool_]:
    """Return which triangles (f, 3) have three distinct vertices, (f,)."""
    return np.asarray(np.all(faces != np.roll(faces, 1, axis=1), axis=1))
