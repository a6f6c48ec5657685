"""Search for the least value along a path by adaptive sampling, without a bound between stations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray

EVEN = 9  # evenly spaced initial stations
MOST = 40  # most stations of a search
CHANGE = 0.02  # least relative improvement that an interval has to promise
STEEPER = 2.0  # assumed slope in an interval over the steepest one beside it


def first_stations(total: float, corners: Sequence[float] | FloatArray, count: int = EVEN) -> FloatArray:
    """Return a path's corners and ``count`` evenly spaced stations, in order."""
    return np.unique(np.concatenate([np.linspace(0.0, total, count), np.asarray(corners, float)]))


def least_along(value: Callable[[float], float], stations: FloatArray) -> FloatArray:
    """Add stations where the least value may lie, and return all of them, (n,), in order.

    The search is that of Piyavskii and Shubert with slopes estimated from the stations beside each interval. It proves
    nothing about values between stations.

    Parameters
    ----------
    value : callable
        Function of the path length, at least zero; the search ends at a zero.
    stations : (m,) array
        Initial stations, in order.
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
    """Return a lower estimate of the least value in each interval, (n - 1,), by the slopes beside it."""
    lengths = np.diff(ways)
    slopes = np.pad(np.abs(np.diff(values)) / lengths, 1)
    steepest = STEEPER * np.max([slopes[:-2], slopes[1:-1], slopes[2:]], axis=0)
    promised: FloatArray = (values[:-1] + values[1:] - steepest * lengths) / 2.0
    return promised
