"""Shaded triangle surfaces: vertex normals that are smooth but for creases."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

CREASE = 30.0  # degrees between triangles above which their common edge is a crease
LOOSE = 0.1  # share of loose ends among crease vertices above which creases are noise and not drawn
SAME = 1e-6  # share of the size: nearer vertices are merged
STEPS = 32767  # quantisation steps of a normal's component


@dataclass(frozen=True)
class Surface:
    """Triangle surface with vertex normals and creases.

    Parameters
    ----------
    positions, normals : (n, 3) array
        Metres; unit, outward. A vertex on a crease occurs once for each side.
    faces : (m, 3) array of int
    edges : (k, 2, 3) array
        Ends of the creases, metres; none for a noisy surface.
    """

    positions: FloatArray
    normals: FloatArray
    faces: NDArray[np.int64]
    edges: FloatArray

    def to_dict(self) -> Json:
        """Return the arrays as base64 text of little-endian numbers: 32-bit floats, 16-bit normals, integers."""
        wide = len(self.positions) > np.iinfo(np.uint16).max
        return {
            "positions": packed(self.positions, "<f4"),
            "normals": packed(np.round(STEPS * self.normals), "<i2"),
            "faces": packed(self.faces, "<u4" if wide else "<u2"),
            "wide": wide,
            "edges": packed(self.edges, "<f4"),
        }


def surface(shape: Triangles, crease: float = CREASE) -> Surface:
    """Return triangles with vertex normals: angle-weighted means over triangles within the crease angle.

    Parameters
    ----------
    shape : Triangles
        Counter-clockwise from outside.
    crease : float
        Degrees. The mean is weighted by the triangles' angles at the vertex (Thuermer and Wuethrich 1998).
    """
    vertices, faces = _welded(shape)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    near = float(np.cos(np.radians(crease)))
    owner, at = np.repeat(np.arange(len(faces)), 3), faces.ravel()
    meets = coo_matrix((np.ones(len(at)), (np.arange(len(at)), at)), shape=(len(at), len(vertices))).tocsr()
    pairs = (meets @ meets.T).tocoo()  # pairs of corners at one vertex
    alike = np.sum(normals[owner[pairs.row]] * normals[owner[pairs.col]], axis=1) >= near
    row, col = pairs.row[alike], pairs.col[alike]
    weighted = normals[owner] * _angles(corners).ravel()[:, None]
    mean = np.stack([np.bincount(row, weighted[col, i], len(at)).astype(float) for i in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    key = np.column_stack([at, np.round(1e3 * mean)])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return Surface(vertices[at[first]], mean[first], which.reshape(-1, 3), _creases(vertices, faces, normals, near))


def packed(values: NDArray[np.float64] | NDArray[np.int64], kind: str) -> str:
    """Return numbers as base64 of a numpy type."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def cut(shape: Triangles, enough: int) -> FloatArray:
    """Return the corners (m, 3, 3) of triangles, each subdivided into four until there are enough."""
    corners = shape.vertices[shape.faces]
    while 0 < len(corners) < enough:
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return corners


def _welded(shape: Triangles) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return merged vertices, and the triangles with nonzero area."""
    step = SAME * max(float(np.max(np.ptp(shape.vertices, axis=0), initial=0.0)), 1e-300)
    _, first, which = np.unique(np.round(shape.vertices / step), axis=0, return_index=True, return_inverse=True)
    faces = which.ravel()[shape.faces]
    a, b, c = faces.T
    return shape.vertices[first], faces[(a != b) & (b != c) & (c != a)]


def _angles(corners: FloatArray) -> FloatArray:
    """Return the angles of triangles (m, 3, 3) at their corners, (m, 3), radians."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(ahead, back), axis=2)
    return np.asarray(np.arctan2(across, np.sum(ahead * back, axis=2)))


def _creases(vertices: FloatArray, faces: NDArray[np.int64], normals: FloatArray, near: float) -> FloatArray:
    """Return the edges (k, 2, 3) between triangles that meet at more than the crease angle, without isolated ones."""
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(ends.T)
    ends, owner = ends[order], owner[order]
    twice = np.flatnonzero(np.all(ends[1:] == ends[:-1], axis=1))
    sharp = np.sum(normals[owner[twice]] * normals[owner[twice + 1]], axis=1) < near
    edges = ends[twice[sharp]]
    often = np.bincount(edges.ravel(), minlength=1)
    run_on = np.sum(often == 1) <= LOOSE * np.sum(often > 0)
    return vertices[edges] if run_on else np.zeros((0, 2, 3))
