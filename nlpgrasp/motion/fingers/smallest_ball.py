"""Smallest enclosing ball of a few points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray

INSIDE = 1e-12  # relative tolerance


def smallest_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius of the smallest ball around points (k, space), metres, by Welzl's algorithm."""
    return _around(list(points), [], points.shape[1])


def _around(points: Sequence[FloatArray], on: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball around ``points`` with the points of ``on`` on its surface."""
    if not points or len(on) == space + 1:
        return _through(on, space)
    first, rest = points[0], points[1:]
    centre, radius = _around(rest, on, space)
    if np.linalg.norm(first - centre) <= radius * (1.0 + INSIDE):
        return centre, radius
    return _around(rest, [*on, first], space)


def _through(on: Sequence[FloatArray], space: int) -> tuple[FloatArray, float]:
    """Return the smallest ball through points; one of radius -1 for none."""
    if not on:
        return np.zeros(space), -1.0
    sides = np.array(on[1:]).reshape(-1, space) - on[0]
    shares = np.linalg.lstsq(sides @ sides.T, np.sum(sides**2, axis=1) / 2.0, rcond=None)[0]
    out = sides.T @ shares
    return on[0] + out, float(np.linalg.norm(out))
