"""Local coordinates of geometry that lies far from the origin, so that sums and single precision keep their digits."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

FAR = 16.0  # longest sides from the origin: nearer geometry is worked on as it is stated


def local_origin(points: FloatArray, beyond: float = FAR) -> FloatArray:
    """Return the origin (3,) of coordinates local to points (n, 3), metres: the box centre on each axis that is far.

    It is 0 on the other axes. With ``beyond`` of at least 1 the difference of a point and this origin, and the sum that
    leads back, are exact in floating point (Sterbenz), so points return unchanged.

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
    """Return points (..., 3) relative to an origin (3,); unchanged, signs of zeros too, where it is 0."""
    return points - origin if np.any(origin) else points
