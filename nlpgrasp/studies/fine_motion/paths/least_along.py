"""Least value along a path, searched for at stations chosen one after another: no bound between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray

EVEN = 9  # stations at equal distances that a search begins with
MOST = 40  # stations of a search
CHANGE = 0.02  # relative: a search ends where no interval promises a value this much below the least
STEEPER = 2.0  # times the steepest slope seen beside an interval: the slope that is assumed in it


def first_stations(total: float, corners: Sequence[float] | FloatArray, count: int = EVEN) -> FloatArray:
    """Return the corners of a path of this length and ``count`` stations at equal distances, in order."""
    return np.unique(np.concatenate([np.linspace(0.0, total, count), np.asarray(corners, float)]))


def least_along(value: Callable[[float], float], stations: FloatArray) -> FloatArray:
    """Add stations where the least value may be, and return all of them, (n,), in order.

    The search is that of Piyavskii and Shubert with slopes estimated from the stations beside each interval. It is no
    proof: what the path does between two stations is not known.

    Parameters
    ----------
    value : callable
        Of the way along the path, at least zero; a search ends where it is zero.
    stations : (m,) array
        Where it begins, in order.
    """
    ways = [float(way) for way in stations]
    values = [value(way) for way in ways]
    while 1 < len(ways) < MOST and min(values) > 0.0:
        promised = _promised(np.array(ways), np.array(values))
        i = int(np.argmin(promised))
        middle = (ways[i] + ways[i + 1]) / 2.0
        if promised[i] >= (1.0 - CHANGE) * min(values) or not ways[i] < middle < ways[i + 1]:
            break
        ways.insert(i + 1, middle)
        values.insert(i + 1, value(middle))
    return np.array(ways)


def _promised(ways: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least value that each interval may have, (n - 1,), by the slopes beside it."""
    lengths = np.diff(ways)
    slopes = np.pad(np.abs(np.diff(values)) / lengths, 1)
    steepest = STEEPER * np.max([slopes[:-2], slopes[1:-1], slopes[2:]], axis=0)
    promised: FloatArray = (values[:-1] + values[1:] - steepest * lengths) / 2.0
    return promised
