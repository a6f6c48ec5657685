"""Quality measure nu, the volume of the grasp wrench set W (Section 3.2): certified bounds and an estimate.

With bilateral contacts only, ``G(B_1^n)`` is an ellipsoid and its volume a closed form (3.2-2). Otherwise support
points span an inner polytope P, cut into simplices with their apex c inside. On the cone of a cell with plane
``<a, x - c> = 1`` the set W extends at most ``r = phi_W(a) - <a, c>`` times as far as P, so

    ``sum_cells vol  <=  nu  <=  U = sum_cells r^d vol``,

both certified. In the plane they meet. In six dimensions they are far apart, and rays narrow them: for a cell drawn
with probability ``r^d vol / U`` and x uniform on its facet, with ``c + t x`` on the boundary of W, nu is
``U E[(t / r)^d]``, the mean of independent variables between 0 and 1. Forces that exert a wrench and a plane that W is
behind bound t from below and above, and the empirical Bernstein inequality (Maurer and Pontil 2009, theorem 4,
arXiv:0907.3740) bounds the mean: with n values of variance V it is less than

    ``(2 V L / n)^(1/2) + 7 L / (3 (n - 1))``,    ``L = log(2 / chance)``,

above their average, but for that chance. Bounds so found say in ``trust`` that they rest on it.
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

# bounds and estimate by rays
CHANCE = 1e-9  # that a bound by rays is wrong
WIDTH = 5.0  # of the certified interval, over the tolerance of the estimate, at which no further rays are drawn
FIRST_RAYS, MOST_RAYS = 1000, 256_000
ERRORS = 3.0  # standard errors in the error bar
MOST_STEPS = 8  # most Newton steps per ray: the few that are left near the sides of the cone of wrenches take long
BRACKET = 2e-3  # relative width of a bracket of a ray's end that is narrow enough
GAUGE_TOLERANCE = 1e-8  # residual of the least forces
CLOSED = 0.55  # share of rays into W above which a grasp is closed; of others W is within a half space
MOST_FORCE = 200.0  # least force of a unit ray in whitened coordinates above which the ray counts as outside
RAY_LIMIT = f"its {MOST_RAYS} rays do not narrow it further"  # reason of a wide certified interval
SAMPLED = f"random rays, which mislead in less than one of {1.0 / CHANCE:.0e} runs"
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
    volume = _certify_volume(whitened, rtol, np.random.default_rng(seed))
    factor = float(np.prod(values))
    return replace(
        volume,
        lower=volume.lower * factor,
        upper=volume.upper * factor,
        torque_scale=scale,
        value=volume.value * factor,
        error=volume.error * factor,
    )


def _certify_volume(whitened: WrenchSet, rtol: float, rng: np.random.Generator) -> Volume:
    """Return certified bounds, estimate and error bar for a set in well-conditioned coordinates."""
    d = len(whitened.G)
    inner, points = _initial_wrench_hull(whitened, rng)
    limit = POINTS[d] if rtol < LOOSE or d == 3 else int(REDUCED_SHARE * POINTS[d])
    while len(points) < limit and inner.upper > inner.lower * (1.0 + rtol):
        count = min(len(points), limit - len(points))
        loosest = np.argsort(-inner.missing)[:count]
        points = np.concatenate([points, _shrunk_points(whitened.support(inner.planes[loosest])[1], rng)])
        inner = _InnerPolytope(whitened, points)
    if inner.upper <= inner.lower * (1.0 + rtol):
        middle, half = 0.5 * (inner.lower + inner.upper), 0.5 * (inner.upper - inner.lower)
        return Volume(inner.lower, inner.upper, value=middle, error=half)
    return _volume_by_rays(whitened, inner, rtol, rng)


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


def _volume_by_rays(whitened: WrenchSet, inner: _InnerPolytope, rtol: float, rng: np.random.Generator) -> Volume:
    """Return bounds, estimate and error bar by rays from the inner polytope's centre through its cells.

    Rays are added, each time as many as there are, until the error bar is ``rtol`` and the interval ``WIDTH`` times as
    wide; the chance of a wrong bound is divided over these times.
    """
    cells, d = inner.cells, len(whitened.G)
    parts = cells.reach**d * cells.sizes
    total, likelihoods = float(np.sum(parts)), parts / np.sum(parts)
    shares, chance, volume = np.zeros((0, 2)), CHANCE, Volume(inner.lower, inner.upper)
    while True:
        count = len(shares) or FIRST_RAYS
        chosen = rng.choice(len(parts), size=count, p=likelihoods)
        rays = np.einsum("mi,mid->md", rng.dirichlet(np.ones(d), count), cells.corners[chosen])
        ends = _ends_of_rays(whitened, cells.centre, rays, cells.reach[chosen])
        shares = np.concatenate([shares, (ends / cells.reach[chosen, None]) ** d])
        chance, count = 0.5 * chance, len(shares)
        log = np.log(4.0 / chance)  # either end may be wrong
        doubt = np.sqrt(2.0 * shares.var(axis=0, ddof=1) * log / count) + 7.0 * log / (3.0 * (count - 1))
        low, high = total * np.clip(shares.mean(axis=0) + [-1.0, 1.0] * doubt, 0.0, 1.0)
        lower, upper = max(volume.lower, low * (1.0 - MARGIN)), min(volume.upper, high * (1.0 + MARGIN))
        values = shares.mean(axis=1)
        value = min(max(total * float(values.mean()), lower), upper)
        error = ERRORS * total * float(values.std(ddof=1)) / count**0.5
        volume = Volume(lower, upper, value=value, error=min(error, 0.5 * (upper - lower)), trust=SAMPLED)
        if error <= rtol * value and upper <= lower * (1.0 + WIDTH * rtol):
            return volume
        if count >= MOST_RAYS:
            return replace(volume, limit=RAY_LIMIT)


def _ends_of_rays(whitened: WrenchSet, centre: FloatArray, x: FloatArray, high: FloatArray) -> FloatArray:
    """Return bounds (m, 2) on the largest t with ``centre + t x`` in W, for t between 1 and ``high``.

    By Newton's method from outside: planes of W are crossed at upper bounds. The gauge is convex along the ray, so that
    a secant between a wrench inside and one outside crosses 1 at a lower bound.
    """
    gauge, low, high = _gauge(whitened), np.ones(len(x)), high.copy()
    inside = np.minimum(gauge(centre + x)[0], 1.0)  # of the wrench at low; x is on the inner polytope
    t, active = high.copy(), np.arange(len(x))
    for _ in range(MOST_STEPS):
        now = t[active]
        value, y = gauge(centre + now[:, None] * x[active])
        slope = np.sum(y * x[active], axis=1)
        room = whitened.support(y)[0] - y @ centre
        crossing = np.divide(room, slope, out=np.full(len(slope), np.inf), where=slope > 0.0)
        high[active] = np.minimum(high[active], crossing)
        is_inside, is_finite = value <= 1.0, np.isfinite(value)
        excess = np.where(is_finite & ~is_inside, value - inside[active], np.inf)
        secant = low[active] + (now - low[active]) * (1.0 - inside[active]) / excess
        inside[active] = np.where(is_inside, value, np.where(secant > low[active], 1.0, inside[active]))
        low[active] = np.maximum(low[active], np.where(is_inside, now, secant))
        # at a side of the cone G K of all wrenches the gauge jumps from below 1 to infinity: bisection alone ends
        t[active] = np.where(is_finite, high[active], 0.5 * (low[active] + high[active]))
        active = active[high[active] > low[active] * (1.0 + BRACKET)]
        if not active.size:
            break
    return np.stack([np.minimum(low, high), high], axis=1)


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
        ``log nu`` at a torque scale of 1 m; minus infinity without force closure: then half of all rays leave W at the
        origin.
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
        is_produced &= force > 0.0
        if np.mean(is_produced) < CLOSED:
            return cls(-np.inf, np.zeros(len(rays)), y)
        d = rays.shape[1]
        force = np.where(is_produced, force, np.inf)  # the others are abandoned: W is thinner along them
        powers = (np.min(force) / force) ** d
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
            is_produced = np.linalg.norm(unit - x @ whitened.G.T, axis=1) <= 1e1 * GAUGE_TOLERANCE
            divisor = np.where(is_produced & (force > 0.0), force, 1.0)
            return np.where(is_produced, force * size, np.inf), y / divisor[:, None]
        x, y = conic.LeastForces(whitened).solve(unit)
        amount = whitened.force_set.gauge(x) * size
        return np.where(np.isfinite(amount), amount, np.inf), y

    return gauge
