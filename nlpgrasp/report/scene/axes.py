"""Coordinate axes in a scene: origin and lengths, such that a body does not hide them."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

NEAR = 2.0  # largest distance of a drawn origin from the body's middle, in body sizes
SHORTEST, BEYOND = 0.5, 0.3  # shares of the body's size: least length of an axis, and its length beyond the body
DIGITS = 7  # decimals of coordinates for display, metres


def has_origin(low: FloatArray, high: FloatArray, size: float) -> bool:
    """Return whether the frame's origin is near enough to a body to be drawn.

    Parameters
    ----------
    low, high : (3,) array
        Ends of the body's bounds, metres.
    size : float
        Of the body, metres.
    """
    return float(np.linalg.norm((low + high) / 2.0)) <= NEAR * size


def body_axes(low: FloatArray, high: FloatArray, size: float, count: int = 3) -> Json:
    """Return the axes of a body's frame, at its origin or, if that is far away, at the body's lowest corner.

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
        ``at``: their origin; ``ends``: ends of x, y and z; metres, body frame.
    """
    at = np.zeros(3) if has_origin(low, high, size) else low
    inside = (low <= at) & (at <= high)
    lengths = np.maximum(SHORTEST * size, np.where(inside, high - at + BEYOND * size, 0.0))
    return frame_axes(at, lengths[:count])


def frame_axes(at: FloatArray, lengths: FloatArray) -> Json:
    """Return axes of given lengths (k,) at a point (3,); metres, in the format of ``body_axes``."""
    ends = at + np.diag(np.pad(lengths, (0, 3 - len(lengths))))[: len(lengths)]
    return {"at": np.round(at, DIGITS).tolist(), "ends": np.round(ends, DIGITS).tolist()}
