"""Monte Carlo volume of a wrench set from its radial function relative to an inner polytope.

``vol(W) = vol(P) E[t^d]`` for points x uniform over P's surface (by cones about c), with ``c + t (x - c)`` on the
boundary of W: t is close to 1, so its mean needs few samples. On the boundary the least force that produces a wrench
is 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets.sets.l2 import L2Set
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.quality.forces import conic
from nlpgrasp.quality.forces.dual_newton import dual_newton

GROUPS = 16  # independent groups of samples, whose scatter gives the error
ERRORS = 3.0  # standard errors in the error bar
MOST_SAMPLES = 400_000
MOST_STEPS = 30  # most Newton steps per ray
CLOSE = 1e-3  # tolerance of the gauge on the boundary
BRACKET = 5e-3  # width of a bracket whose midpoint is accepted (its errors average out)
GAUGE_TOLERANCE = 1e-8
FAR = 4.0  # least force above which a wrench is certainly outside the set

Gauge = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Cells:
    """An inner polytope P of W as cones about a point c, one per facet.

    Parameters
    ----------
    centre : (d,) array
        c.
    corners : (f, d, d) array
        Each cell's vertices relative to c, one per row.
    sizes, reach : (f,) array
        Their volumes, and upper bounds of W's radial extent relative to P.
    """

    centre: FloatArray
    corners: FloatArray
    sizes: FloatArray
    reach: FloatArray


def estimate(white: WrenchSet, cells: Cells, rtol: float, rng: np.random.Generator) -> tuple[float, float]:
    """Estimate the volume of a wrench set and its error bar by stratified sampling over the cells.

    Parameters
    ----------
    white : WrenchSet
        W, in well-conditioned coordinates.
    cells : Cells
    rtol : float
        Target relative error bar.
    rng : numpy.random.Generator
    """
    gauge = _gauge(white)
    d = len(cells.centre)
    ends = np.cumsum(cells.sizes)
    count, total = 100, float(ends[-1])
    means: list[FloatArray] = []
    weights: list[int] = []
    while True:
        group, high = [], []
        for _ in range(GROUPS):
            where = (np.arange(count) + rng.random(count)) / count * total
            chosen = np.minimum(np.searchsorted(ends, where), len(ends) - 1)
            share = rng.dirichlet(np.ones(d), count)
            high.append(cells.reach[chosen])
            group.append(np.einsum("mi,mid->md", share, cells.corners[chosen]))
        t = _reach(gauge, cells.centre, np.concatenate(group), np.concatenate(high)) ** d
        means.append(t.reshape(GROUPS, count).mean(axis=1))
        weights.append(count)
        each = np.average(np.array(means), axis=0, weights=weights)
        value, error = float(each.mean()), ERRORS * float(each.std(ddof=1)) / GROUPS**0.5
        if error <= rtol * value or GROUPS * sum(weights) >= MOST_SAMPLES:
            return total * value, total * error
        count = int(np.clip(sum(weights) * ((error / (rtol * value)) ** 2 - 0.8), 50, MOST_SAMPLES / GROUPS))


def _reach(gauge: Gauge, centre: FloatArray, x: FloatArray, high: FloatArray) -> FloatArray:
    """Solve ``gauge(centre + t x) = 1`` for t between 1 and ``high``, by bracketed Newton's method.

    The gauge is convex along the ray, at most 1 at t = 1 and at least 1, perhaps infinite, at ``high``.
    """
    t, low, high = np.ones(len(x)), np.ones(len(x)), high.copy()
    going = np.arange(len(x))
    for _ in range(MOST_STEPS):
        value, gradient = gauge(centre + t[going, None] * x[going])
        known = np.isfinite(value)
        slope = np.maximum(np.sum(np.where(known[:, None], gradient, 0.0) * x[going], axis=1), 1e-9)
        below = value <= 1.0
        low[going] = np.where(below, t[going], low[going])
        high[going] = np.where(below, high[going], t[going])
        newton = t[going] + (1.0 - np.where(known, value, 1.0)) / slope
        middle = 0.5 * (low[going] + high[going])
        t[going] = np.where(known, np.clip(newton, low[going], high[going]), middle)
        going = going[~known | (np.abs(value - 1.0) > CLOSE)]  # the error left is quadratic in that
        narrow = high[going] - low[going] <= BRACKET  # where the set ends at a side of the cone G K: no gauge there
        t[going[narrow]] = 0.5 * (low[going[narrow]] + high[going[narrow]])
        going = going[~narrow]
        if not going.size:
            break
    return t


def _gauge(white: WrenchSet) -> Gauge:
    """Return the gauge function, the least force that produces a wrench, with its gradient."""

    def gauge(w: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = np.linalg.norm(w, axis=1)
        unit = w / np.where(size > 0.0, size, 1.0)[:, None]
        if isinstance(white.force_set, L2Set):
            y, x = dual_newton(white, unit, GAUGE_TOLERANCE, FAR / float(np.min(size)))
            force = np.linalg.norm(x, axis=1)
            produced = np.linalg.norm(unit - x @ white.G.T, axis=1) <= 1e3 * GAUGE_TOLERANCE
            return np.where(produced, force * size, np.inf), y / np.where(produced & (force > 0.0), force, 1.0)[:, None]
        x, y = conic.least_forces(white, unit)
        used = white.force_set.used(x) * size
        return np.where(np.isfinite(used), used, np.inf), y

    return gauge
