"""The axes of a frame in a scene: from where, and how long, so that a body does not hide them."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

NEAR = 2.0  # of the body's size, from its middle: an origin farther away is left out of the picture
SHORTEST, BEYOND = 0.5, 0.3  # of the body's size: length of an axis, and how far it sticks out of the body
DIGITS = 7  # after the point, metres: what is for looking at


def has_origin(low: FloatArray, high: FloatArray, size: float) -> bool:
    """Return whether the frame's origin is near enough to a body to be drawn with it.

    Parameters
    ----------
    low, high : (3,) array
        Ends of the body's bounds, metres.
    size : float
        Of the body, metres.
    """
    return float(np.linalg.norm((low + high) / 2.0)) <= NEAR * size


def body_axes(low: FloatArray, high: FloatArray, size: float, count: int = 3) -> Json:
    """Return the axes of a body's frame: at its origin, or at the body's lowest corner where that is far away.

    Parameters
    ----------
    low, high : (3,) array
        Ends of the body's bounds, metres.
    size : float
        Of the body, metres.
    count : int
        2 for a planar body, else 3.

    Returns
    -------
    dict
        ``at``: where they begin; ``ends``: where x, y and z end; metres, body frame.
    """
    at = np.zeros(3) if has_origin(low, high, size) else low
    inside = (low <= at) & (at <= high)
    lengths = np.maximum(SHORTEST * size, np.where(inside, high - at + BEYOND * size, 0.0))
    return frame_axes(at, lengths[:count])


def frame_axes(at: FloatArray, lengths: FloatArray) -> Json:
    """Return axes of the lengths given, (k,), that begin at a point (3,); metres, as ``body_axes`` does."""
    ends = at + np.diag(np.pad(lengths, (0, 3 - len(lengths))))[: len(lengths)]
    return {"at": np.round(at, DIGITS).tolist(), "ends": np.round(ends, DIGITS).tolist()}
