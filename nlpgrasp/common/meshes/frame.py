"""Local coordinates for geometry far from the origin, against loss of precision."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

FAR = 16.0  # longest sides: distance from the origin beyond which local coordinates are used


def local_origin(points: FloatArray, beyond: float = FAR) -> FloatArray:
    """Return the origin (3,) of local coordinates of points (n, 3), metres: the box centre on each far axis.

    It is 0 on the other axes. With ``beyond`` of at least 1 the difference of a point and this origin, and the inverse
    sum, are exact in floating point (Sterbenz), so points are restored exactly.

    Parameters
    ----------
    points : (n, 3) array
        Metres.
    beyond : float
        Distance from the origin that counts as far, in longest sides of the bounding box.
    """
    if not len(points):
        return np.zeros(3)
    lower, upper = points.min(axis=0), points.max(axis=0)
    centre = lower + (upper - lower) / 2.0
    return np.where(np.abs(centre) > beyond * float(np.max(upper - lower)), centre, 0.0)


def in_frame(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Return points (..., 3) relative to an origin (3,); unchanged if it is 0."""
    return points - origin if np.any(origin) else points
