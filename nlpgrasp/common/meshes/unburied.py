"""Removal of buried triangles of a mesh, by subdivision of intersecting triangles.

For parts that cannot be united. A triangle that no other intersects is buried entirely or not at all. Intersected
triangles are bisected repeatedly until no piece is intersected; small pieces that still are intersected are removed,
which leaves a slit along the seam.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.meshes.crossings import covered, crossing, crossing_triangles, in_plane, normals_of
from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.meshes.winding import BESIDE, buried
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

SMALL = 1e-3  # of the size: length below which triangles are not bisected
MOST_PIECES = 1_000_000


def without_buried(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) and triangles (f, 3) of the exposed surface of a mesh.

    Raises
    ------
    InputError
        When too many triangles intersect.
    """
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    corners = vertices[faces]
    pairs = crossing_triangles(vertices, faces, BESIDE * size)
    one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
    upon = _alike(one, other) & (in_plane(one, other, BESIDE * size) | in_plane(other, one, BESIDE * size))
    pairs = pairs[~(upon & (pairs[:, 0] < pairs[:, 1]))]
    whole = np.ones(len(faces), dtype=bool)
    whole[pairs[:, 0]] = False
    every = np.concatenate([corners[whole], _pieces(corners, pairs, size)])
    kept = every[~buried(vertices, faces, every.mean(axis=1), normals_of(every))]
    places, numbers = np.unique(kept.reshape(-1, 3), axis=0, return_inverse=True)
    return places, np.asarray(numbers).reshape(-1, 3).astype(np.int64)


def _pieces(corners: FloatArray, pairs: IntArray, size: float) -> FloatArray:
    """Return the pieces (n, 3, 3) of bisected intersecting triangles, without small pieces still intersected.

    Pieces that lie on an earlier triangle with the same orientation are also removed.
    """
    owners: IntArray = np.unique(pairs[:, 0])
    piece: IntArray = np.searchsorted(owners, pairs[:, 0])
    pieces, cutter = corners[owners], pairs[:, 1]
    done = [np.zeros((0, 3, 3))]
    while len(pieces):
        cut = np.zeros(len(pieces), dtype=bool)
        cut[piece] = True
        small = _longest(pieces) <= SMALL * size
        done.append(pieces[~cut])
        pieces, owners, piece, cutter = _halved(pieces, owners, piece, cutter, cut & ~small)
        if len(pieces) + sum(map(len, done)) > MOST_PIECES:
            raise InputError(
                "Mesh.mesh", "a surface that crosses itself in too many triangles", "parts joined to one closed surface"
            )
        some, others = pieces[piece], corners[cutter]
        upon = covered(some, others, BESIDE * size)
        twice = np.zeros(len(pieces), dtype=bool)
        twice[piece[upon & _alike(some, others) & (cutter < owners[piece])]] = True
        still = crossing(some, others, BESIDE * size) & ~upon & ~twice[piece]
        numbers = np.cumsum(~twice) - 1
        pieces, owners, piece, cutter = pieces[~twice], owners[~twice], numbers[piece[still]], cutter[still]
    return np.concatenate(done)


def _alike(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    """Return which triangles (p, 3, 3) have normals within 90 degrees of others' (p, 3, 3), pair by pair."""
    return np.asarray(np.einsum("ij,ij->i", normals_of(one), normals_of(other)) > 0.0)


def _longest(pieces: FloatArray) -> FloatArray:
    """Return the longest sides (n,) of triangles (n, 3, 3)."""
    return np.asarray(np.max(np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2), axis=1))


def _halved(
    pieces: FloatArray, owners: IntArray, piece: IntArray, cutter: IntArray, which: NDArray[np.bool_]
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Return selected pieces bisected at their longest side, with owners and pairs, without the other pieces."""
    chosen = pieces[which]
    sides = np.linalg.norm(np.roll(chosen, -1, axis=1) - chosen, axis=2)
    order = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(chosen, order[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2.0
    halves = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    kept = which[piece]
    first = (np.cumsum(which) - 1)[piece[kept]]
    return (
        halves,
        np.tile(owners[which], 2),
        np.concatenate([first, first + len(chosen)]),
        np.tile(cutter[kept], 2),
    )
