"""Sandwich algorithm for certified bounds on mu, resumable at any gap.

Support points ``s_j`` of the wrench set W span an inner polytope P, cut into cells around a centre c in its
interior. A cell with plane ``{x : <a, x - c> = 1}`` allows ``alpha <= (1 + <a, c>) / phi_A(a)``; the least of these is
a **lower** bound on the largest alpha with ``alpha A`` inside W. Without force closure the origin is a vertex of W:
planes through it allow all multiples of the task or none, and their cells are ranked by the height of the sought
multiple above them, seen from c. The exact ratio ``phi_W(y) / phi_A(y)`` at any
direction y is an **upper** bound, and its maximiser is a new point of P.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import Containment, make_containment
from nlpgrasp.quality.convex_hull import IncrementalHull
from nlpgrasp.quality.force_closure import has_no_support, separate_wrench, separating_direction
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.provable_ends import (
    ForceCones,
    provable_lower,
    provable_upper,
    provable_zero,
    trust_in_task,
    vertex_rounding,
)
from nlpgrasp.quality.ratio_minimisation import descend, random_directions, select_separated
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task

SHRINK = 1e-4  # largest relative shrinking of support points, which avoids degeneracy and keeps them inside W
# what an interval rests on besides real arithmetic
NO_WORK = "that no force of the contacts works along the worst direction, to rounding"
FLAT_WRENCHES = "wrenches that are flat, to rounding"
SUPPORT = "the support of the wrench set as computed"
COARSER = 10.0  # factor on the relative width with which bounds are computed again where rounding tore the hull
SEEDS, DESCENT = 24, 12  # descents before the first hull, and their steps
BATCH = 6  # most new points per round: of more, some lie inside the hull of the others
SPREAD = 0.3  # least separation of a round's normals (1 - cosine), relative to the gap
# points, and share of the target below which rounding then limits the lower bound
ROUNDING_LIMITS = ((250, 1e-6), (600, 0.3))
MOST_POINTS = 6000  # most hull points, some million cells
TIME_LIMIT, POINT_LIMIT = "the time was up", f"{MOST_POINTS} points of its polytope did not suffice"
ROUNDING_LIMIT = "contacts that nearly coincide, or closure that is nearly lost, leave floating point no better"


@dataclass
class Sandwich:
    """State of the sandwich algorithm: upper bound, worst direction and inner hull.

    Parameters
    ----------
    upper : float
        Least support ratio so far.
    worst : (r,) array
        Its direction.
    hull : IncrementalHull or None
        Inner hull of support points; None if there is nothing to certify or no hull could be built.
    limit : str
        Reason for ending before the tolerance.
    """

    upper: float
    worst: FloatArray
    hull: IncrementalHull | None = None
    limit: str = ROUNDING_LIMIT


def sandwich(
    problem: Containment, rtol: float, seed: int = 0, deadline: float | None = None, warm_start: Sandwich | None = None
) -> Bounds:
    """Return certified bounds on the largest alpha with ``alpha A`` inside the wrench set.

    Parameters
    ----------
    problem : Containment
    rtol : float
        Stop when ``upper <= lower (1 + rtol)``.
    seed : int
        Random seed.
    deadline : float, optional
        ``time.monotonic()`` value after which the bounds reached so far are returned.
    warm_start : Sandwich, optional
        Warm start of the same containment; changed in place if its tolerance allows reuse.

    Returns
    -------
    Bounds
        ``worst_direction`` is a unit direction in the original wrench coordinates. Wider than ``rtol`` only after the
        deadline or at the limits of floating point, as ``limit`` says.
    """
    state = tighten(problem, rtol, seed, deadline, warm_start)
    direction = problem.to_wrench_direction(state.worst)
    if state.upper == 0.0:
        return no_work(*problem.given, direction)
    if problem.rank == 1:
        ends = state.upper * (1.0 - problem.rounding), state.upper * (1.0 + problem.rounding)
        return Bounds(*ends, direction, trust=FLAT_WRENCHES)
    bounds = _ends(problem, state, direction)
    if bounds.lower <= 0.0 and (proof := _separate_task(problem, state.worst)) is not None:
        return no_work(*problem.given, problem.to_wrench_direction(proof))
    if bounds.upper <= bounds.lower * (1.0 + rtol) * (1.0 + 2.0 * problem.rounding):
        return bounds
    is_torn = state.limit == ROUNDING_LIMIT and bounds.upper > bounds.lower * (1.0 + COARSER * rtol)
    if is_torn and COARSER * rtol < 1.0:  # by rounding: a hull of fewer points may be whole
        bounds = max(bounds, sandwich(problem, COARSER * rtol, seed, deadline), key=lambda found: found.lower)
    return replace(bounds, limit=state.limit)


def _ends(problem: Containment, state: Sandwich, y: FloatArray) -> Bounds:
    """Return both ends as they hold in real arithmetic, with what they rest on besides and the vertices of a proof."""
    wrenches, task = problem.given
    trust, matrix = [trust_in_task(task)], problem.matrix
    domain = ForceCones.of(wrenches)
    upper, _ = provable_upper(wrenches, domain, y, task)
    if not upper < np.inf:
        upper = state.upper * (1.0 + problem.rounding)
        trust.append(SUPPORT)
    if state.hull is None:
        return Bounds(0.0, upper, y, trust="; ".join(filter(None, trust)))
    is_flat = problem.rank < len(wrenches.G)
    if is_flat:
        trust.append(FLAT_WRENCHES)
        wrenches, task, matrix = problem.wrenches, problem.task, np.eye(problem.rank)
    variables, cells = state.hull.vertices()
    variables = domain.into(variables)
    lower = provable_lower(wrenches, variables, cells, state.hull.cell_planes() @ matrix, task)
    lower = lower if state.hull.is_sound else 0.0
    proof = variables if lower > 0.0 and not is_flat else None
    return Bounds(min(lower, upper), upper, y, trust="; ".join(filter(None, trust)), vertices=proof)


def no_work(wrenches: WrenchSet, task: Task, y: FloatArray) -> Bounds:
    """Return 0 as mu: no force does work along a direction (d,) that the task requires, proved where it can be."""
    upper, above = provable_zero(wrenches, ForceCones.of(wrenches), y, task)
    if upper > 0.0:
        return Bounds(0.0, 0.0, y, trust=NO_WORK)
    return Bounds(0.0, 0.0, above.direction / np.linalg.norm(above.direction), trust=trust_in_task(task))


def _separate_task(problem: Containment, u: FloatArray) -> FloatArray | None:
    """Return a direction (r,) that proves that no multiple of the task is exerted, or None if none is found.

    It separates the wrench of the task that is farthest along a direction u (r,) from all that the contacts exert.
    """
    wrench = problem.task.support(u[None, :])[1][0]
    y = separate_wrench(problem.wrenches, wrench) if wrench.any() else None
    is_proof = y is not None and y @ wrench > 0.0 and has_no_support(problem.wrenches, y)
    return y if is_proof else None


def tighten(
    problem: Containment, rtol: float, seed: int = 0, deadline: float | None = None, warm_start: Sandwich | None = None
) -> Sandwich:
    """Run the sandwich algorithm to a tolerance, and return its state before certification."""
    rng = np.random.default_rng(seed)
    shrink = min(SHRINK, 0.01 * rtol)
    # the points of a warm start are shrunk by SHRINK
    state = _initial_state(problem, shrink, rng) if warm_start is None or shrink < SHRINK else warm_start
    while state.hull is not None and state.upper > 0.0:
        hull = state.hull
        if len(hull) >= MOST_POINTS or (deadline is not None and time.monotonic() >= deadline):
            state.limit = POINT_LIMIT if len(hull) >= MOST_POINTS else TIME_LIMIT
            break
        target = state.upper / (1.0 + 0.8 * rtol)
        cells, shares = hull.exceeded(target, 8 * BATCH)
        if not cells.size or _is_limited_by_rounding(len(hull), shares[0]):
            break
        normals = hull.normals(cells)
        values, variables = problem.wrenches.variables(normals)
        reach = problem.task.support(normals)[0]
        ratios = np.divide(values, reach, out=np.full(len(reach), np.inf), where=reach > 0.0)
        best = int(np.argmin(ratios))
        if ratios[best] < state.upper:
            state.upper, state.worst = float(ratios[best]), normals[best]
            if has_no_support(problem.wrenches, state.worst):
                return Sandwich(0.0, state.worst)
        gap = max(1.0 - shares[0], rtol)
        chosen = select_separated(normals, np.arange(len(cells)), 1.0 - SPREAD * gap, BATCH)
        if not hull.insert(*inner_points(problem, variables[chosen], shrink, rng)):
            break
    return state


def _initial_state(problem: Containment, shrink: float, rng: np.random.Generator) -> Sandwich:
    """Return the initial state of the sandwich algorithm, from descents and the first hull."""
    seeds = np.concatenate([random_directions(SEEDS, problem.rank, rng), np.linalg.svd(problem.wrenches.G)[0].T])
    directions, values = descend(problem, seeds, DESCENT)
    separating = separating_direction(problem.wrenches)
    best = int(np.argmin(values))
    state = Sandwich(float(values[best]), directions[best])
    if separating is not None:
        ratio = float(problem.ratio(separating[None, :])[0][0])
        if ratio <= state.upper or (has_no_support(problem.wrenches, separating) and np.isfinite(ratio)):
            state = Sandwich(ratio, separating)
        elif np.isfinite(ratio):
            separating = None
    if has_no_support(problem.wrenches, state.worst):
        return Sandwich(0.0, state.worst)
    if problem.rank == 1:
        return state
    start = directions[select_separated(directions, np.argsort(values), 0.95, 14)]
    state.hull = _initial_hull(problem, start, shrink, separating is not None, rng)
    return state


def _is_limited_by_rounding(points: int, share: float) -> bool:
    """Return whether rounding, not the number of points, limits the lower bound."""
    return any(points > largest_count and share < least_share for largest_count, least_share in ROUNDING_LIMITS)


def inner_points(
    problem: Containment, variables: FloatArray, shrink: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return wrenches of variables, shrunk towards the origin by small random factors, and the variables so shrunk."""
    variables = variables * (1.0 - shrink * rng.random((len(variables), 1)))
    return problem.wrenches.exert(variables), variables


def _initial_hull(
    problem: Containment, start: FloatArray, shrink: float, with_origin: bool, rng: np.random.Generator
) -> IncrementalHull | None:
    """Return the hull of support points in given and random directions; None if the points stay flat.

    Flat points are completed in the directions across them, which random ones rarely are: of contacts that nearly
    coincide, one is the farthest in almost all. An origin on the boundary of W is added as a vertex.
    """
    for count in (8, 40, 200):
        u = np.concatenate([start, random_directions(count, problem.rank, rng)])
        points, variables = inner_points(problem, problem.wrenches.variables(u)[1], shrink, rng)
        if with_origin:
            points, variables = (np.concatenate([np.zeros((1, rows.shape[1])), rows]) for rows in (points, variables))
        try:
            return IncrementalHull(
                points, variables, lambda planes: problem.task.support(planes)[0], vertex_rounding(problem.wrenches)
            )
        except np.linalg.LinAlgError:
            axes = np.linalg.svd(points - points.mean(axis=0))[2]
            start = np.concatenate([start, axes, -axes])
    return None


@dataclass(frozen=True)
class ResumableCertificate:
    """Resumable certificate of a grasp for a task: the state of the sandwich algorithm.

    Parameters
    ----------
    grasp : Grasp
    task : Task
    budget : ForceBudget
    containment : Containment
        Of the task in the grasp's wrench set.
    sandwich : Sandwich
    """

    grasp: Grasp
    task: Task
    budget: ForceBudget
    containment: Containment
    sandwich: Sandwich

    @classmethod
    def of(cls, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float) -> ResumableCertificate | None:
        """Return the certificate tightened to a tolerance; None if rank alone proves that mu is 0."""
        problem, _ = make_containment(WrenchSet.of(grasp, budget), task)
        return None if problem is None else cls(grasp, task, budget, problem, tighten(problem, rtol))

    def belongs_to(self, grasp: Grasp, budget: ForceBudget) -> bool:
        """Return whether the certificate is of a grasp with these contacts under this budget.

        Contact points and normals have to be identical, and the budget the same object.
        """
        has_same_points = np.array_equal(self.grasp.points, grasp.points)
        return budget is self.budget and has_same_points and np.array_equal(self.grasp.normals, grasp.normals)

    def bounds(self, rtol: float, deadline: float | None = None) -> Bounds:
        """Return certified bounds on mu, resuming from the current state of the sandwich algorithm."""
        bounds = sandwich(self.containment, rtol, 0, deadline, self.sandwich)
        return bounds.of_measure(self.task.measure, self.task.paper_beta)
