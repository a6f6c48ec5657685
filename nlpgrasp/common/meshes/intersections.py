"""Intersection and overlap tests for triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

FEW = 48  # most boxes compared pairwise
PARALLEL = 1.0 - 1e-6  # cosine of the angle below which axes are parallel
AT_ONCE = 200_000  # pairs per batch


def intersecting_boxes(lower: FloatArray, upper: FloatArray) -> IntArray:
    """Return the index pairs (p, 2) of axis-aligned boxes (n, 3) that intersect, smaller index first.

    Boxes are split recursively at the median of their centres, with those across it in both halves, until few are left
    or splitting does not help.
    """
    pairs: list[IntArray] = [np.zeros((0, 2), dtype=np.int64)]
    subsets: list[IntArray] = [np.arange(len(lower))]
    while subsets:
        subset = subsets.pop()
        if len(subset) > FEW:
            middle = (lower[subset] + upper[subset]) / 2.0
            axis = int(np.argmax(np.ptp(middle, axis=0)))
            median = float(np.median(middle[:, axis]))
            halves = subset[lower[subset, axis] <= median], subset[upper[subset, axis] >= median]
            if max(map(len, halves)) <= 0.8 * len(subset):
                subsets.extend(halves)
                continue
        pairs.extend(_all_pairs(subset, lower, upper))
    return np.asarray(np.unique(np.concatenate(pairs), axis=0))


def _all_pairs(subset: IntArray, lower: FloatArray, upper: FloatArray) -> Iterator[IntArray]:
    """Yield the intersecting pairs among some boxes, found by pairwise comparison."""
    batch_size = max(1, AT_ONCE // len(subset))
    for start in range(0, len(subset), batch_size):
        batch = subset[start : start + batch_size]
        overlap = np.all((lower[batch, None] <= upper[subset]) & (lower[subset] <= upper[batch, None]), axis=2)
        i, j = batch[np.nonzero(overlap)[0]], subset[np.nonzero(overlap)[1]]
        yield np.stack([i, j], axis=1)[i < j]


def intersecting_triangles(vertices: FloatArray, faces: IntArray, slack: float) -> IntArray:
    """Return the index pairs (p, 2), in both orders, of triangles that intersect or touch.

    Triangles with a common vertex are left out.
    """
    corners = vertices[faces]
    pairs = intersecting_boxes(corners.min(axis=1) - slack, corners.max(axis=1) + slack)
    disjoint = ~np.any(faces[pairs[:, 0]][:, :, None] == faces[pairs[:, 1]][:, None], axis=(1, 2))
    pairs = pairs[disjoint]
    pairs = pairs[triangles_intersect(corners[pairs[:, 0]], corners[pairs[:, 1]], slack)]
    return np.concatenate([pairs, pairs[:, ::-1]])


def triangles_intersect(first: FloatArray, second: FloatArray, slack: float) -> BoolArray:
    """Return whether each triangle (p, 3, 3) intersects or touches its partner (p, 3, 3).

    A separating axis shows that they do not. Along a triangle's normal a gap of up to ``slack`` still counts as
    touching; along other axes an overlap of at least ``slack`` is required, so that adjacent triangles in a plane do
    not count.
    """
    parts = [slice(start, start + AT_ONCE) for start in range(0, len(first), AT_ONCE)]
    return np.concatenate([np.zeros(0, dtype=bool), *(_batch_intersects(first[s], second[s], slack) for s in parts)])


def _batch_intersects(first: FloatArray, second: FloatArray, slack: float) -> BoolArray:
    """Return whether each triangle of a batch intersects its partner, by separating axes."""
    normals = normals_of(first), normals_of(second)
    result: BoolArray = np.all([_gap(first, second, normal) <= slack for normal in normals], axis=0)
    remaining = np.flatnonzero(result)
    sides = [np.moveaxis(np.roll(t[remaining], -1, axis=1) - t[remaining], 1, 0) for t in (first, second)]
    axes = [np.cross(a, b) for a in sides[0] for b in sides[1]]
    axes += [np.cross(n[remaining], side) for n, edges in zip(normals, sides, strict=True) for side in edges]
    for candidate in axes:
        left = result[remaining]
        indices, axis = remaining[left], candidate[left]
        length = np.linalg.norm(axis, axis=1)
        axis = axis / np.maximum(length, 1e-300)[:, None]
        alignment = np.maximum(*(np.abs(np.einsum("ij,ij->i", axis, n[indices])) for n in normals))
        separated = (length > 0.0) & (alignment < PARALLEL) & (_gap(first[indices], second[indices], axis) > -slack)
        result[indices[separated]] = False
    return np.asarray(result)


def is_covered(first: FloatArray, second: FloatArray, slack: float) -> BoolArray:
    """Return whether each triangle (p, 3, 3) lies entirely on its partner (p, 3, 3), within ``slack``."""
    from_corner = first[:, :, None] - second[:, None]  # pair, corner of one, corner of the other
    result = in_plane(first, second, slack)
    inwards = np.cross(normals_of(second)[:, None], np.roll(second, -1, axis=1) - second)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=2), 1e-300)[:, :, None]
    return np.asarray(result & np.all(np.einsum("pijk,pjk->pij", from_corner, inwards) >= -slack, axis=(1, 2)))


def in_plane(first: FloatArray, second: FloatArray, slack: float) -> BoolArray:
    """Return whether each triangle (p, 3, 3) lies in the plane of its partner (p, 3, 3), within ``slack``."""
    offsets = np.einsum("pik,pk->pi", first - second[:, :1], normals_of(second))
    return np.asarray(np.all(np.abs(offsets) <= slack, axis=1))


def normals_of(corners: FloatArray) -> FloatArray:
    """Return the unit normals (p, 3) of triangles (p, 3, 3), zero for degenerate triangles."""
    products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(products / np.maximum(np.linalg.norm(products, axis=1), 1e-300)[:, None])


def _gap(triangles: FloatArray, others: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the gap between each triangle and its partner along a unit axis (p, 3), negative for overlap, (p,)."""
    first, second = (np.einsum("pij,pj->ip", corners, axis) for corners in (triangles, others))
    return np.asarray(np.maximum(second.min(axis=0) - first.max(axis=0), first.min(axis=0) - second.max(axis=0)))
