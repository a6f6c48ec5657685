"""Intersection and overlap tests of triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.validation import FloatArray

FEW = 48  # most boxes compared pairwise
PARALLEL = 1.0 - 1e-6  # cosine of the angle below which axes are parallel
AT_ONCE = 200_000  # pairs per batch


def meeting_boxes(lower: FloatArray, upper: FloatArray) -> IntArray:
    """Return the index pairs (p, 2), smaller first, of intersecting axis-aligned boxes (n, 3).

    Boxes are split recursively at the median of their centres, with those across it in both halves, until few are left
    or splitting does not help.
    """
    found: list[IntArray] = [np.zeros((0, 2), dtype=np.int64)]
    waiting: list[IntArray] = [np.arange(len(lower))]
    while waiting:
        these = waiting.pop()
        if len(these) > FEW:
            middle = (lower[these] + upper[these]) / 2.0
            axis = int(np.argmax(np.ptp(middle, axis=0)))
            at = float(np.median(middle[:, axis]))
            halves = these[lower[these, axis] <= at], these[upper[these, axis] >= at]
            if max(map(len, halves)) <= 0.8 * len(these):
                waiting.extend(halves)
                continue
        found.extend(_all_pairs(these, lower, upper))
    return np.asarray(np.unique(np.concatenate(found), axis=0))


def _all_pairs(these: IntArray, lower: FloatArray, upper: FloatArray) -> Iterator[IntArray]:
    """Yield the intersecting pairs among some boxes, by pairwise comparison."""
    rows = max(1, AT_ONCE // len(these))
    for start in range(0, len(these), rows):
        some = these[start : start + rows]
        meet = np.all((lower[some, None] <= upper[these]) & (lower[these] <= upper[some, None]), axis=2)
        one, other = some[np.nonzero(meet)[0]], these[np.nonzero(meet)[1]]
        yield np.stack([one, other], axis=1)[one < other]


def intersecting_triangles(vertices: FloatArray, faces: IntArray, slack: float) -> IntArray:
    """Return the index pairs (p, 2), in both orders, of triangles without common vertex that intersect or touch."""
    corners = vertices[faces]
    pairs = meeting_boxes(corners.min(axis=1) - slack, corners.max(axis=1) + slack)
    apart = ~np.any(faces[pairs[:, 0]][:, :, None] == faces[pairs[:, 1]][:, None], axis=(1, 2))
    pairs = pairs[apart]
    pairs = pairs[crossing(corners[pairs[:, 0]], corners[pairs[:, 1]], slack)]
    return np.concatenate([pairs, pairs[:, ::-1]])


def crossing(one: FloatArray, other: FloatArray, slack: float) -> NDArray[np.bool_]:
    """Return which triangles (p, 3, 3) intersect or touch others (p, 3, 3), pair by pair.

    A separating axis shows that they do not. Along a triangle's normal a gap of up to ``slack`` still counts as
    touching; along other axes an overlap of at least ``slack`` is required, so that adjacent triangles in a plane do
    not count.
    """
    parts = [slice(start, start + AT_ONCE) for start in range(0, len(one), AT_ONCE)]
    return np.concatenate([np.zeros(0, dtype=bool), *(_segments_intersect(one[s], other[s], slack) for s in parts)])


def _segments_intersect(one: FloatArray, other: FloatArray, slack: float) -> NDArray[np.bool_]:
    normals = normals_of(one), normals_of(other)
    result = np.ones(len(one), dtype=bool)
    for normal in normals:
        result &= _gap(one, other, normal) <= slack
    sides = np.roll(one, -1, axis=1) - one, np.roll(other, -1, axis=1) - other
    axes = [np.cross(a, b) for a in np.moveaxis(sides[0], 1, 0) for b in np.moveaxis(sides[1], 1, 0)]
    axes += [np.cross(n, s) for n, both in zip(normals, sides, strict=True) for s in np.moveaxis(both, 1, 0)]
    for across in axes:
        left = np.flatnonzero(result)
        axis = across[left]
        length = np.linalg.norm(axis, axis=1)
        axis = axis / np.maximum(length, 1e-300)[:, None]
        along = np.maximum(*(np.abs(np.einsum("ij,ij->i", axis, n[left])) for n in normals))
        parted = (length > 0.0) & (along < PARALLEL) & (_gap(one[left], other[left], axis) > -slack)
        result[left[parted]] = False
    return result


def is_covered(one: FloatArray, other: FloatArray, slack: float) -> NDArray[np.bool_]:
    """Return which triangles (p, 3, 3) lie entirely on others (p, 3, 3), within ``slack``, pair by pair."""
    from_corner = one[:, :, None] - other[:, None]  # pair, corner of one, corner of the other
    result = in_plane(one, other, slack)
    inwards = np.cross(normals_of(other)[:, None], np.roll(other, -1, axis=1) - other)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=2), 1e-300)[:, :, None]
    return np.asarray(result & np.all(np.einsum("pijk,pjk->pij", from_corner, inwards) >= -slack, axis=(1, 2)))


def in_plane(one: FloatArray, other: FloatArray, slack: float) -> NDArray[np.bool_]:
    """Return which triangles (p, 3, 3) lie in the plane of others (p, 3, 3), within ``slack``, pair by pair."""
    off = np.einsum("pik,pk->pi", one - other[:, :1], normals_of(other))
    return np.asarray(np.all(np.abs(off) <= slack, axis=1))


def normals_of(corners: FloatArray) -> FloatArray:
    """Return the unit normals (p, 3) of triangles (p, 3, 3), zero for degenerate ones."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None])


def _gap(one: FloatArray, other: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the gaps (p,) between triangles along unit axes (p, 3), negative for overlap."""
    first, second = (np.einsum("pij,pj->pi", corners, axis) for corners in (one, other))
    return np.asarray(np.maximum(second.min(axis=1) - first.max(axis=1), first.min(axis=1) - second.max(axis=1)))
