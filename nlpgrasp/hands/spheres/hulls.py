"""Convex hulls of collision shapes, and penetration depths of two links in a batch of postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.directions import directions_around
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.spheres.shapes import Shape

MOST = 64  # most corners, and normals, of a hull
BETWEEN = 60  # further directions: for contact of edges with edges
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Hull:
    """Corners and normals of a shape's convex hull.

    Parameters
    ----------
    corners : (v, 3) array
        Metres, link frame; of a hull with many, the extreme points in ``MOST`` directions.
    normals : (d, 3) array
        Unit; of a hull with many, ``MOST`` directions all around.
    """

    corners: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, shape: Shape) -> Hull:
        """Return the hull of a shape."""
        hull = shape.mesh.convex_hull
        corners, normals = np.asarray(hull.vertices), np.unique(np.asarray(hull.face_normals).round(6), axis=0)
        around = directions_around(UP, MOST)
        if len(corners) > MOST:
            corners = corners[np.unique(np.argmax(corners @ around.T, axis=0))]
        return cls(corners, normals if len(normals) <= MOST else around)


def meet(one: Sequence[Hull], other: Sequence[Hull], frames: FloatArray) -> FloatArray:
    """Return the largest penetration depth of the hulls of two links, (b,), metres; negative where they are apart.

    Two convex sets are disjoint if, in some direction, one's support function plus the other's in the opposite
    direction is negative. The least sum over the hulls' normals and further directions is an upper bound on the depth.

    Parameters
    ----------
    one, other : sequence of Hull
        Of each link.
    frames : (b, 4, 4) array
        Of the other link in the first one's.
    """
    turns, moves = frames[:, :3, :3], frames[:, :3, 3]
    return np.asarray(np.max([_depth(a, b, turns, moves) for a in one for b in other], axis=0, initial=-np.inf))


def _depth(a: Hull, b: Hull, turns: FloatArray, moves: FloatArray) -> FloatArray:
    there = b.corners @ turns.transpose(0, 2, 1) + moves[:, None]  # (b, v, 3), the first one's frame
    fixed = np.concatenate([a.normals, directions_around(UP, BETWEEN)])
    own = np.max(a.corners @ fixed.T, axis=0) - np.min(there @ fixed.T, axis=1)
    turned = b.normals @ turns.transpose(0, 2, 1)  # (b, d, 3); these point out of b
    swapped = turned.transpose(0, 2, 1)
    across = np.max(there @ swapped, axis=1) - np.min(a.corners @ swapped, axis=1)
    return np.asarray(np.minimum(own.min(axis=1), across.min(axis=1)))
