"""Quality measure nu, the volume of the grasp wrench set W (Section 3.2): certified bounds and an estimate.

With bilateral contacts only, ``G(B_1^n)`` is an ellipsoid and its volume a closed form (3.2-2). Otherwise support
points span an inner polytope P, cut into simplices with their apex c inside. On the cone of a cell with plane
``<a, x - c> = 1`` the set W extends at most ``r = phi_W(a) - <a, c>`` times as far as P, so

    ``sum_cells vol  <=  nu  <=  sum_cells r^d vol``,

both certified. Between these bounds ``estimate_volume`` samples ``vol(W) = vol(P) E[t^d]`` for points x uniform over
P's surface (by cones about c), with ``c + t (x - c)`` on the boundary of W: t is close to 1, so its mean needs few
samples. On the boundary the least force that produces a wrench is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import factorial, gamma, pi
from typing import Self, overload

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.common.formatting import format_interval
from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.quality import force_problem as conic
from nlpgrasp.quality.arguments import require_grasp
from nlpgrasp.quality.bounds import SHOWN, Bounds
from nlpgrasp.quality.dual_newton import dual_newton
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.quality.wrench_set import WrenchSet, torque_factors, wrench_rank

# certified bounds
POINTS = {3: 2000, 6: 300}  # most vertices of P, by dimension
LOOSE, REDUCED_SHARE = 0.015, 0.5  # tolerance above which this share of the vertices is enough
SHRINK = 1e-5  # largest relative shrinking of support points towards the origin
MARGIN = 1e-5  # relative guard against rounding of volumes
ROUNDING = 1e-9  # relative guard against rounding of the closed form, and of the heights of flat cells

# estimate
GROUPS = 16  # independent groups of samples, whose scatter gives the error
ERRORS = 3.0  # standard errors in the error bar
MOST_SAMPLES = 400_000  # of all groups
MOST_STEPS = 30  # most Newton steps per ray
GAUGE_CLOSE = 1e-3  # tolerance of the gauge on the boundary
BRACKET = 5e-3  # width of a bracket whose midpoint is accepted (its errors average out)
GAUGE_TOLERANCE = 1e-8  # residual of the least forces
MOST_FORCE = 200.0  # least force of a unit ray in whitened coordinates above which the ray counts as outside
POINT_LIMIT = "the inner polytope has its most vertices"  # reason of a wide certified interval
FORCE_LIMIT = 4.0  # least force above which a wrench is certainly outside the set

Gauge = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # wrenches (m, d) to least forces (m,), gradients (m, d)


@dataclass(frozen=True)
class Volume(Bounds):
    """Volume nu: certified ``lower`` and ``upper``, and an estimate ``value`` with an error bar.

    Parameters
    ----------
    lower, upper, torque_scale
        As in ``Bounds``, without a worst direction.
    value : float
        Estimate in N^d, with torques over ``torque_scale``.
    error : float
        Three standard errors of the estimate, or half the certified interval if that is smaller.
    """

    value: float = 0.0
    error: float = 0.0

    def to_dict(self) -> dict[str, float]:
        """Return bounds, torque scale, estimate and error bar as JSON data."""
        return {**super().to_dict(), "value": self.value, "error": self.error}

    @classmethod
    def from_dict(cls, data: Mapping[str, float], name: str) -> Self:
        """Return the volume from the data of its ``to_dict``, as ``Bounds.from_dict`` does."""
        return replace(super().from_dict(data, name), value=data["value"], error=data["error"])

    def __str__(self) -> str:
        return f"{self.value:.5g} +- {self.error:.2g}, certified {super().__str__()}"

    def __repr__(self) -> str:
        lower, upper = format_interval(self.lower, self.upper, SHOWN)
        return f"Volume({lower}, {upper}, value={self.value:.5g}, error={self.error:.2g})"


@overload
def nu(
    grasp: Grasp,
    torque_scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> Volume: ...


@overload
def nu(
    grasp: GraspStack,
    torque_scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> tuple[Volume, ...]: ...


def nu(
    grasp: Grasp | GraspStack,
    torque_scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> Volume | tuple[Volume, ...]:
    """Return nu (3.2-1): the volume of ``G(B ∩ K)``.

    It does not depend on the body frame or the torque origin (Theorem 3-2), and it does not imply stability: a grasp
    that is not force-closed has a volume too.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``, which divides the volume by its power.
    rtol : float
        Target relative error bar; in the plane, relative width of the certified interval.
    force_budget : str or ForceBudget
        As for ``mu``.
    seed : int
        Of the samples.

    Returns
    -------
    Volume
        For a stack, one for each grasp.
    """
    require_grasp(grasp, stack=True)
    seed = integer("seed", seed, at_least=0, at_most=2**63 - 1)
    if isinstance(grasp, GraspStack):
        return tuple(nu(g, torque_scale, rtol, force_budget=force_budget, seed=seed) for g in grasp)
    units = torque_factors(grasp, torque_scale)
    scale = float(torque_scale)
    rtol = number("rtol", rtol, above=0.0)
    d = grasp.dimension
    wrench_set = WrenchSet.of(grasp, force_budget).transformed(np.diag(units))
    if wrench_rank(wrench_set.G.T) < d:
        return Volume(0.0, 0.0, torque_scale=scale)
    vectors, values, _ = np.linalg.svd(wrench_set.G)
    if wrench_set.is_ellipsoid:
        exact = pi ** (d / 2) / gamma(d / 2 + 1) * float(np.prod(values))
        return Volume(
            exact * (1.0 - ROUNDING), exact * (1.0 + ROUNDING), torque_scale=scale, value=exact, error=exact * ROUNDING
        )
    whitened = wrench_set.transformed((vectors / values).T)
    lower, upper, value, error = _certify_volume(whitened, rtol, np.random.default_rng(seed))
    factor = float(np.prod(values))
    return Volume(
        lower * factor,
        upper * factor,
        torque_scale=scale,
        value=value * factor,
        error=error * factor,
        limit="" if upper <= lower * (1.0 + rtol) else POINT_LIMIT,
    )


def _certify_volume(whitened: WrenchSet, rtol: float, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return certified bounds, estimate and error bar for a set in well-conditioned coordinates."""
    d = len(whitened.G)
    inner, points = _initial_wrench_hull(whitened, rng)
    limit = POINTS[d] if rtol < LOOSE or d == 3 else int(REDUCED_SHARE * POINTS[d])
    while len(points) < limit and inner.upper > inner.lower * (1.0 + rtol):
        count = min(len(points), limit - len(points))
        loosest = np.argsort(-inner.missing)[:count]
        points = np.concatenate([points, _shrunk_points(whitened.support(inner.planes[loosest])[1], rng)])
        inner = _InnerPolytope(whitened, points)
    middle, half = 0.5 * (inner.lower + inner.upper), 0.5 * (inner.upper - inner.lower)
    if inner.upper <= inner.lower * (1.0 + rtol):
        return inner.lower, inner.upper, middle, half
    value, error = estimate_volume(whitened, inner.cells, rtol, rng)
    return inner.lower, inner.upper, min(max(value, inner.lower), inner.upper), min(error, half)


def _initial_wrench_hull(whitened: WrenchSet, rng: np.random.Generator) -> tuple[_InnerPolytope, FloatArray]:
    """Return the hull of the origin and support points in random directions, and the points.

    For a set with few vertices, few directions may give flat points; then more directions are used.
    """
    d = len(whitened.G)
    for count in (8 * d, 80 * d, 2000 * d):
        phi, points = whitened.support(random_directions(5 * count, d, rng))
        points = points[phi > 1e-6 * np.max(phi)]
        if count > 8 * d:
            points = np.unique(np.round(points, 9), axis=0)
            points = points[rng.permutation(len(points))]
        points = np.concatenate([np.zeros((1, d)), _shrunk_points(points[: min(count, 2 * POINTS[d])], rng)])
        try:
            return _InnerPolytope(whitened, points), points
        except NlpgraspError as error:
            failure = error
    raise failure


def _shrunk_points(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return points shrunk towards the origin by small random factors, so that they are in general position."""
    return np.asarray(points * (1.0 - SHRINK * rng.random((len(points), 1))))


@dataclass(frozen=True)
class PolytopeCells:
    """An inner polytope P of W, divided into one simplex per facet with its apex at a point c.

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


class _InnerPolytope:
    """Inner polytope of W by Qhull, and the volume bounds that it gives.

    The incremental hull of ``convex_hull`` covers all directions, as a bound on mu requires, but its cells may overlap
    where points are coplanar; volumes need cells that do not.
    """

    def __init__(self, whitened: WrenchSet, points: FloatArray) -> None:
        d = points.shape[1]
        centre = np.asarray(np.mean(points, axis=0))
        hull, corners, sizes = _filled_hull(points - centre)
        normals = hull.equations[:, :-1]
        heights = np.min(np.einsum("fvd,fd->fv", corners, normals), axis=1)
        # a point sum l_i v_i of the cell's cone has <n, x> >= height sum l_i, and <n, x> at most the support
        support = whitened.support(normals)[0] - normals @ centre
        is_proper = (heights > ROUNDING * np.max(heights)) & (sizes > 0.0)
        self.planes = normals[is_proper]
        self.cells = PolytopeCells(
            centre, corners[is_proper], sizes[is_proper], np.maximum(support[is_proper] / heights[is_proper], 1.0)
        )
        self.missing = (self.cells.reach**d - 1.0) * self.cells.sizes
        # cells left out are flat or have the centre on their planes: their cones are thinner than rounding
        self.lower = min(float(np.sum(self.cells.sizes)), float(hull.volume)) * (1.0 - MARGIN)
        self.upper = float(np.sum(self.cells.reach**d * self.cells.sizes)) * (1.0 + MARGIN)


def _filled_hull(points: FloatArray) -> tuple[ConvexHull, FloatArray, FloatArray]:
    """Return the hull of points about the origin, and the corners and volumes of simplices that fill it.

    If Qhull's triangulation of merged facets does not fill it, the input is joggled, which avoids merged facets.
    """
    d = points.shape[1]
    for options in (None, "QJ", "QJ1e-9", "QJ1e-7", "QJ1e-5"):
        try:
            hull = ConvexHull(points, qhull_options=options)
        except QhullError:
            continue
        cells = points[hull.simplices]
        sizes = np.abs(np.linalg.det(cells)) / factorial(d)
        if abs(float(np.sum(sizes)) - hull.volume) <= MARGIN * hull.volume:
            return hull, cells, sizes
    raise NlpgraspError("nu: no hull of this grasp's support points is filled by its simplices")


def estimate_volume(
    whitened: WrenchSet, cells: PolytopeCells, rtol: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Estimate the volume of a wrench set and its error bar by stratified sampling over the cells.

    Parameters
    ----------
    whitened : WrenchSet
        W, in well-conditioned coordinates.
    cells : PolytopeCells
    rtol : float
        Target relative error bar.
    rng : numpy.random.Generator
    """
    gauge = _gauge(whitened)
    d = len(cells.centre)
    cumulative = np.cumsum(cells.sizes)
    count, total = 100, float(cumulative[-1])
    means: list[FloatArray] = []
    weights: list[int] = []
    while True:
        group, high = [], []
        for _ in range(GROUPS):
            positions = (np.arange(count) + rng.random(count)) / count * total
            chosen = np.minimum(np.searchsorted(cumulative, positions), len(cumulative) - 1)
            barycentric = rng.dirichlet(np.ones(d), count)
            high.append(cells.reach[chosen])
            group.append(np.einsum("mi,mid->md", barycentric, cells.corners[chosen]))
        t = _radial_reach(gauge, cells.centre, np.concatenate(group), np.concatenate(high)) ** d
        means.append(t.reshape(GROUPS, count).mean(axis=1))
        weights.append(count)
        group_means = np.average(np.array(means), axis=0, weights=weights)
        value, error = float(group_means.mean()), ERRORS * float(group_means.std(ddof=1)) / GROUPS**0.5
        if error <= rtol * value or GROUPS * sum(weights) >= MOST_SAMPLES:
            return total * value, total * error
        count = int(np.clip(sum(weights) * ((error / (rtol * value)) ** 2 - 0.8), 50, MOST_SAMPLES / GROUPS))


def _radial_reach(gauge: Gauge, centre: FloatArray, x: FloatArray, high: FloatArray) -> FloatArray:
    """Solve ``gauge(centre + t x) = 1`` for t between 1 and ``high``, by bracketed Newton's method.

    The gauge is convex along the ray, at most 1 at t = 1 and at least 1, perhaps infinite, at ``high``.
    """
    t, low, high = np.ones(len(x)), np.ones(len(x)), high.copy()
    active = np.arange(len(x))
    for _ in range(MOST_STEPS):
        value, gradient = gauge(centre + t[active, None] * x[active])
        is_finite = np.isfinite(value)
        slope = np.maximum(np.sum(np.where(is_finite[:, None], gradient, 0.0) * x[active], axis=1), 1e-9)
        is_inside = value <= 1.0
        low[active] = np.where(is_inside, t[active], low[active])
        high[active] = np.where(is_inside, high[active], t[active])
        newton = t[active] + (1.0 - np.where(is_finite, value, 1.0)) / slope
        middle = 0.5 * (low[active] + high[active])
        t[active] = np.where(is_finite, np.clip(newton, low[active], high[active]), middle)
        # t is a Newton step past value: its error is quadratic in GAUGE_CLOSE
        active = active[~is_finite | (np.abs(value - 1.0) > GAUGE_CLOSE)]
        # at a side of the cone G K of all wrenches the gauge jumps from below 1 to infinity: bisection alone ends
        is_bracketed = high[active] - low[active] <= BRACKET
        t[active[is_bracketed]] = 0.5 * (low[active[is_bracketed]] + high[active[is_bracketed]])
        active = active[~is_bracketed]
        if not active.size:
            break
    return t


@dataclass(frozen=True)
class RadialVolume:
    """Volume of W estimated by rays from the origin, under the L2 budget, with the data of its gradient.

    In coordinates in which unit directions u are uniform, ``nu = V_d mean rho(u)^d`` with the radial function
    ``rho(u) = 1 / gauge(u)``. The gauge is ``max <y, u> / phi(y)``. At the maximiser y, scaled to ``phi(y) = 1``, the
    envelope theorem gives ``d rho / rho = d phi(y)``, the change of the support with y held fixed, so that

        ``d log nu = d sum_u weight(u) d phi(y_u)``,    ``weight(u) = rho(u)^d / sum rho^d``.

    Parameters
    ----------
    log : float
        ``log nu`` at a torque scale of 1 m; minus infinity where a ray leaves W at the origin, as in a grasp without
        force closure.
    weights : (m,) array
    normals : (m, d) array
        The maximisers y.
    """

    log: float
    weights: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, wrenches: WrenchSet, matrix: FloatArray, rays: FloatArray) -> RadialVolume:
        """Return the volume estimated by unit rays (m, d), in wrench coordinates ``matrix w``."""
        whitened = wrenches.transformed(matrix)
        y, x = dual_newton(whitened, rays, GAUGE_TOLERANCE, MOST_FORCE)
        force = np.linalg.norm(x, axis=1)
        is_produced = np.linalg.norm(rays - x @ whitened.G.T, axis=1) <= 1e3 * GAUGE_TOLERANCE
        if not np.all(is_produced & (force > 0.0)):
            return cls(-np.inf, np.zeros(len(rays)), y)
        powers = (np.min(force) / force) ** rays.shape[1]
        d = rays.shape[1]
        ball = pi ** (d / 2) / gamma(d / 2 + 1) / abs(float(np.linalg.det(matrix)))
        log = float(np.log(ball * np.mean(powers)) - d * np.log(np.min(force)))
        return cls(log, powers / np.sum(powers), (y / force[:, None]) @ matrix)


def whitening(grasp: Grasp) -> FloatArray:
    """Return a matrix (d, d) of wrench coordinates in which ``G G^T`` is the identity; needs full rank."""
    scales = np.linalg.norm(grasp.G, axis=1)
    vectors, values, _ = np.linalg.svd(grasp.G / scales[:, None])
    return np.asarray((vectors / values).T / scales)


def _gauge(whitened: WrenchSet) -> Gauge:
    """Return the gauge function: the least force that produces a wrench, and its gradient."""

    def gauge(w: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = np.linalg.norm(w, axis=1)
        unit = w / np.where(size > 0.0, size, 1.0)[:, None]
        if isinstance(whitened.force_set, L2Set):
            y, x = dual_newton(whitened, unit, GAUGE_TOLERANCE, FORCE_LIMIT / float(np.min(size)))
            force = np.linalg.norm(x, axis=1)
            is_produced = np.linalg.norm(unit - x @ whitened.G.T, axis=1) <= 1e3 * GAUGE_TOLERANCE
            divisor = np.where(is_produced & (force > 0.0), force, 1.0)
            return np.where(is_produced, force * size, np.inf), y / divisor[:, None]
        x, y = conic.LeastForces(whitened).solve(unit)
        amount = whitened.force_set.gauge(x) * size
        return np.where(np.isfinite(amount), amount, np.inf), y

    return gauge
