"""nu, the volume of the grasp wrench set (Section 3.2): an estimate with its error, between rigorous bounds.

With bilateral contacts ``G(B_1^n)`` is an ellipsoid and the volume a closed form (3.2-2). Otherwise support points
span an inner polytope P, cut into simplices with their apex c inside. On the cone of a cell with plane
``<a, x - c> = 1`` the set W reaches at most ``r = phi_W(a) - <a, c>`` times as far as P, so

    ``sum_cells vol  <=  nu  <=  sum_cells r^d vol``,

both certified. Between them is an estimate from samples (:mod:`nlpgrasp.quality.radial`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, gamma, pi
from typing import overload

import numpy as np
from scipy.spatial import QhullError

from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.contacts import BilateralContact
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.grasp import Grasp
from nlpgrasp.grasp_stack import GraspStack
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.hull import Hull
from nlpgrasp.quality.minimise import random_directions
from nlpgrasp.quality.radial import estimate
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.validation import FloatArray, number

RANK_TOLERANCE = 1e-10
ROUNDING = 1e-9
POINTS = {2: 2000, 3: 2000, 4: 800, 5: 500, 6: 300}  # most vertices of P
SHRINK = (1e-4, 1e-3, 1e-2)  # of support points towards the origin, one after another until no cells fold over
FOLDS = 1e-7


@dataclass(frozen=True)
class Volume(Bounds):
    """nu: ``lower`` and ``upper`` are certified, ``value`` is an estimate with an error bar.

    Parameters
    ----------
    value : float
        Newtons to the number of forces times, with torques over ``torque_scale``, newtons to that of torques.
    error : float
        Three standard errors of the estimate; half the certified interval where that is narrower.
    """

    value: float = 0.0
    error: float = 0.0

    def __str__(self) -> str:
        return f"{self.value:.5g} +- {self.error:.2g}, certified {super().__str__()}"


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
    """Return nu (3.2-1): the volume of ``G(B n K)``.

    It does not depend on the body frame or on the torque origin (Theorem 3-2), and it does not show stability: a grasp
    that is not force-closed has a volume too.

    Parameters
    ----------
    grasp : Grasp or GraspStack
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``, which divides the volume by its power.
    rtol : float
        Relative error bar to reach; in the plane, relative width of the certified interval.
    force_budget : str or ForceBudget
    seed : int
        Of the samples.

    Returns
    -------
    Volume
        For a stack, one for each grasp.
    """
    if isinstance(grasp, GraspStack):
        return tuple(nu(g, torque_scale, rtol, force_budget=force_budget, seed=seed) for g in grasp)
    scale = number("torque_scale", torque_scale, above=0.0)
    rtol = number("rtol", rtol, above=0.0)
    d, forces = grasp.dimension, grasp.space
    wrench_set = WrenchSet.of(grasp, force_budget).transformed(np.diag([1.0] * forces + [1.0 / scale] * (d - forces)))
    vectors, values, _ = np.linalg.svd(wrench_set.G)
    if len(values) < d or values[-1] <= RANK_TOLERANCE * values[0]:
        return Volume(0.0, 0.0, torque_scale=scale)
    if isinstance(wrench_set.budget, L2Budget) and all(isinstance(c, BilateralContact) for c in grasp.contacts):
        exact = pi ** (d / 2) / gamma(d / 2 + 1) * float(np.prod(values))
        return Volume(
            exact * (1.0 - ROUNDING), exact * (1.0 + ROUNDING), torque_scale=scale, value=exact, error=exact * ROUNDING
        )
    white = wrench_set.transformed((vectors / values).T)
    lower, upper, value, error = _volume(white, rtol, np.random.default_rng(seed))
    factor = float(np.prod(values))
    return Volume(lower * factor, upper * factor, torque_scale=scale, value=value * factor, error=error * factor)


def _volume(white: WrenchSet, rtol: float, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return certified bounds, estimate and error bar for a set in good coordinates."""
    d = len(white.G)
    for shrink in SHRINK:
        try:
            hull = _first_hull(white, shrink, rng)
        except QhullError:
            continue
        lower, upper, cells, sizes, reach = _bounds(white, hull)
        while len(hull) < POINTS[d] and upper > lower * (1.0 + rtol):
            new = white.support(hull.planes[hull.worst(np.inf, max(len(hull) // 4, 4 * d))])[1]
            added = [hull.insert(p) for p in _inside(new, shrink, rng)]
            if not any(added):
                break
            if d <= 3:
                lower, upper, cells, sizes, reach = _bounds(white, hull)
        lower, upper, cells, sizes, reach = _bounds(white, hull)
        if hull.folds() <= FOLDS:
            break
    else:
        raise NlpgraspError("nu: the hull of support points cannot be built for this grasp")
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    if upper <= lower * (1.0 + rtol):
        return lower, upper, middle, half
    value, error = estimate(white, hull.centre, cells, sizes, reach, rtol, rng)
    return lower, upper, min(max(value, lower), upper), min(error, half)


def _first_hull(white: WrenchSet, shrink: float, rng: np.random.Generator) -> Hull:
    """Return the hull of the origin and of support points in random directions."""
    d = len(white.G)
    phi, points = white.support(random_directions(40 * d, d, rng))
    points = points[phi > 1e-6 * np.max(phi)][: 8 * d]
    points = np.concatenate([np.zeros((1, d)), _inside(points, shrink, rng)])
    return Hull(points, lambda planes, centre: 1.0 / (white.support(planes)[0] - planes @ centre))


def _inside(points: FloatArray, shrink: float, rng: np.random.Generator) -> FloatArray:
    """Return points moved towards the origin by small factors: still in the set, but in general position."""
    return np.asarray(points * (1.0 - shrink * rng.random((len(points), 1))))


def _bounds(white: WrenchSet, hull: Hull) -> tuple[float, float, FloatArray, FloatArray, FloatArray]:
    """Return inner and outer volume, the cells' corners about the centre, their volumes, and how far W reaches."""
    d = len(white.G)
    cells, planes, heights = hull.corners()
    sizes = np.abs(np.linalg.det(cells)) / factorial(d)
    # a point sum l_i v_i of the cell's cone has <a, x> >= height sum l_i, and <a, x> at most the support
    reach = np.maximum((white.support(planes)[0] - planes @ hull.centre) / np.maximum(heights, 1e-300), 1.0)
    return (
        float(np.sum(sizes)) * (1.0 - ROUNDING),
        float(np.sum(reach**d * sizes)) * (1.0 + 1e3 * ROUNDING),
        cells,
        sizes,
        reach,
    )
