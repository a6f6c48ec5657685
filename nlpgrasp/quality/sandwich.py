"""Certified bounds by a sandwich (theory, Section 4).

Support points ``s_j`` of the wrench set W span an inner polytope P. Any facet of P with unit normal n and
offset b allows ``alpha <= b / phi_A(n)``; the least of these is a **lower** bound on the largest alpha with
``alpha A`` inside W. The exact ratio ``phi_W(y) / phi_A(y)`` at any direction y is an **upper** bound, and its
maximiser is a new point of P.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.closure import ZERO_SUPPORT, separating_direction
from nlpgrasp.quality.containment import Containment
from nlpgrasp.quality.minimise import descend, random_directions, separated
from nlpgrasp.validation import FloatArray

SHRINK = 1e-4  # relative; removes the degeneracy Qhull cannot handle, keeps every point inside W
ROUNDING = 1e-9  # relative guard for the arithmetic of facets and supports
GROWTH = 0.3  # most new points a round, relative to the points there are
CELL = 1.6  # spacing of new facet normals, in units of the square root of the gap
HASH = np.array([1, 73856093, 19349663, 83492791, 49979687, 67867967])


def sandwich(problem: Containment, rtol: float, seed: int = 0, deadline: float | None = None) -> Bounds:
    """Return certified bounds on the largest alpha with ``alpha A`` inside the wrench set.

    Qhull is only ever called to build a hull from scratch: its incremental mode ends the process on
    degenerate input, while a failed build raises and costs nothing but the lower bound of that round.

    Parameters
    ----------
    problem : Containment
    rtol : float
        Stop when ``upper <= lower (1 + rtol)``.
    seed : int
        Of the random directions and of the shrinking.
    deadline : float, optional
        ``time.monotonic()`` value after which the bounds reached so far are returned.

    Returns
    -------
    Bounds
        ``worst_direction`` is in the problem's own coordinates. Wider than asked only past the deadline or
        where floating point allows no better.
    """
    rng = np.random.default_rng(seed)
    seeds = np.concatenate([random_directions(120, problem.rank, rng), np.linalg.svd(problem.wrenches.G)[0].T])
    found, values = descend(problem, seeds)
    separating = separating_direction(problem.wrenches)
    best = int(np.argmin(values))
    upper, worst = float(values[best]), found[best]
    if separating is not None and problem.ratio(separating[None, :])[0][0] <= upper:
        upper, worst = float(problem.ratio(separating[None, :])[0][0]), separating
    scale = float(np.linalg.norm(problem.wrenches.G, 2))
    if _no_support(problem, worst, scale):
        return Bounds(0.0, 0.0, worst)
    if problem.rank == 1:
        return Bounds(upper * (1.0 - ROUNDING), upper * (1.0 + ROUNDING), worst)

    chosen = separated(found, np.argsort(values), 0.95, 14)
    start = np.concatenate([found[chosen], random_directions(8, problem.rank, rng)])
    points = _inner_points(problem, start, rng)
    if separating is not None:  # the origin is on the boundary: it is a vertex of its own
        points = np.concatenate([np.zeros((1, problem.rank)), points])
    lower = 0.0
    for _ in range(60):
        normals, ratios = _facets(problem, points)
        lower = max(lower, float(np.min(ratios, initial=np.inf)) if ratios.size else 0.0)
        if upper <= lower * (1.0 + rtol) or (deadline is not None and time.monotonic() > deadline):
            break
        candidates = _worst_normals(normals, ratios, upper, rtol, rng) if ratios.size else None
        if candidates is None:
            candidates = random_directions(len(points), problem.rank, rng)
        candidates = candidates[: max(20, int(GROWTH * len(points)))]
        exact = problem.ratio(candidates)[0]
        best = int(np.argmin(exact))
        if exact[best] < upper:
            upper, worst = float(exact[best]), candidates[best]
            if _no_support(problem, worst, scale):
                return Bounds(0.0, 0.0, worst)
        points = np.concatenate([points, _inner_points(problem, candidates, rng)])
    return Bounds(min(lower * (1.0 - ROUNDING), upper), upper * (1.0 + ROUNDING), worst)


def _no_support(problem: Containment, u: FloatArray, scale: float) -> bool:
    """Return whether no contact force works along u (to rounding): the task cannot be resisted there."""
    return bool(problem.wrenches.support(u[None, :])[0][0] <= ZERO_SUPPORT * scale)


def _inner_points(problem: Containment, u: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return support points in directions u, each moved towards the origin by its own small factor."""
    wrench = problem.wrenches.support(u)[1]
    return np.asarray(wrench * (1.0 - SHRINK * rng.random((len(u), 1))))


def _facets(problem: Containment, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return facet normals and ``offset / phi_A(normal)``; empty when Qhull cannot build the hull.

    The offset is taken from the facet's own vertices, the nearest one, not from Qhull's plane.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return np.zeros((0, problem.rank)), np.zeros(0)
    normals = hull.equations[:, :-1]
    offsets = np.min(np.einsum("fvd,fd->fv", points[hull.simplices], normals), axis=1)
    offsets = np.where(np.abs(offsets) < ROUNDING * np.max(np.abs(points)), 0.0, offsets)
    reach = problem.task.support(normals)[0]
    binding = reach > 0.0
    ratios = np.where(binding, offsets / np.where(binding, reach, 1.0), np.inf)
    # an origin outside the polytope proves nothing, whatever the other facets say
    ratios = np.where(~binding & (offsets < 0.0), 0.0, ratios)
    return normals, np.maximum(ratios, 0.0)


def _worst_normals(
    normals: FloatArray, ratios: FloatArray, upper: float, rtol: float, rng: np.random.Generator
) -> FloatArray | None:
    """Return normals of the facets that are still too close, worst first, one from each small cell."""
    target = upper / (1.0 + 0.8 * rtol)
    bad = np.flatnonzero(ratios < target)
    if not bad.size:
        return None
    bad = bad[np.argsort(ratios[bad])]
    spacing = CELL * np.sqrt(max(1.0 - ratios[bad[0]] / target, rtol))
    cells = np.floor(normals[bad] / spacing + rng.random(normals.shape[1])).astype(np.int64)
    _, first = np.unique(cells @ HASH[: normals.shape[1]], return_index=True)
    return normals[bad[np.sort(first)]]
