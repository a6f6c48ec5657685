"""Reference implementations of the paper's algorithms (Sections 3.1 and 3.4), for comparison only.

- ``inscribed_polytope``: a polytope inside ``G(B ∩ K)`` with all its faces; delta is the distance of the closest.
- ``mu_by_steps``: beta is increased as long as the task's wrenches, times beta, stay in that polytope.
- ``polytope_distance``: the test of a wrench, by Wolfe's method (Finding the nearest point in a polytope, 1976,
  doi:10.1007/BF01580381) with vertices from a support function, as in Gilbert, Johnson and Keerthi (1988,
  doi:10.1109/56.2083).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.unit_directions import directions, directions_inradius
from nlpgrasp.common.validation import FloatArray, array, integer, number, read_only
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import random_directions, select_separated
from nlpgrasp.quality.wrench_set import WrenchSet, torque_factors, wrench_rank
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope

# inscribed polytope
VERTICES = 300  # default number of vertices
MOST_VERTICES = {3: 100_000, 6: 1_500}  # by dimension, limited by Qhull's time and memory
ROUNDS = 4  # rounds of refinement beyond the worst faces
SEPARATION = 0.95  # largest cosine between normals of one round
MOST_FACES = 4_000  # most faces considered per round
EXACT = 1e-12  # relative tolerance of an exact polytope

# increments of beta
FIRST_STEP = 0.1  # first step, of the largest possible beta; factor of later steps
SHELLS = 2  # density of the sampled wrenches of an ellipsoid (``directions``)

# distance from a polytope
GAP = 1e-14  # of distance times the polytope's size: tolerance of stationarity
LEAST_WEIGHT = 1e-12  # weight below which a vertex is dropped
MOST_STEPS = 10_000  # default limit of steps

Vertex = Callable[[FloatArray], FloatArray]  # a direction (d,) to the farthest vertex (d,) along it


@dataclass(frozen=True)
class InscribedPolytope:
    """Polytope inscribed in ``G(B ∩ K)``, with all its faces.

    Wrenches are in newtons, torques over ``torque_scale``.

    Parameters
    ----------
    vertices : (m, d) array
        Wrenches of the set, the origin last.
    normals : (f, d) array
        Unit outward normals of the faces; none if the wrenches do not span wrench space.
    distances : (f,) array
        Distances d_i (Section 3.4) of the faces' planes from the origin, newtons, at least zero.
    members : (f, d) array of int
        Vertex indices of each face. A face with more than d vertices is split.
    share : float
        Approximation error: ``share G(B ∩ K)`` is inside the polytope, which is inside ``G(B ∩ K)``; at most 1.
    torque_scale : float
        Metres.
    """

    vertices: FloatArray
    normals: FloatArray
    distances: FloatArray
    members: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    share: float
    torque_scale: float

    @property
    def closest(self) -> int | None:
        """Index of the face closest to the origin, ``None`` without faces."""
        return int(np.argmin(self.distances)) if len(self.distances) else None

    @property
    def delta(self) -> float:
        """Distance of the closest face from the origin, newtons; 0 without faces.

        It is a lower bound on the grasp's delta, and at least ``share`` times it.
        """
        return 0.0 if self.closest is None else float(self.distances[self.closest])


def inscribed_polytope(
    grasp: Grasp,
    vertices: int = VERTICES,
    torque_scale: float = 1.0,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> InscribedPolytope:
    """Return an inscribed polytope of ``G(B ∩ K)``, including the origin, with all its faces.

    The paper's procedure for delta, (3.1-1b), which is the distance of the closest face. For comparison only: ``delta``
    is certified and faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    vertices : int
        Largest number, at least 2 d and at most 1500 in space, where many vertices have very many faces.
    torque_scale : float
        Metres. Converts torques to forces; directions are uniform in these units.
    force_budget : str or ForceBudget
        Bound on the finger forces.
    seed : int
        Of the random directions.

    Returns
    -------
    InscribedPolytope
        Wrenches over their units, distances in newtons.

    Raises
    ------
    InputError
        On numbers out of range, or a budget that does not fit.
    NlpgraspError
        When the hull cannot be built.
    """
    require_grasp(grasp)
    d = grasp.dimension
    count = integer("vertices", vertices, at_least=2 * d, at_most=MOST_VERTICES[d])
    rng = np.random.default_rng(integer("seed", seed, at_least=0, at_most=2**63 - 1))
    wrenches = WrenchSet.of(grasp, force_budget).transformed(np.diag(torque_factors(grasp, torque_scale)))
    count_per_round = max(count // (ROUNDS + 1), d)
    points = np.concatenate([wrenches.support(random_directions(count_per_round, d, rng))[1], np.zeros((1, d))])
    if wrench_rank(points) < d:
        no_faces = np.zeros((0, d))
        return InscribedPolytope(points, no_faces, np.zeros(0), no_faces.astype(np.intp), 0.0, float(torque_scale))
    while True:
        hull = _wrench_hull(points)
        normals, distances = hull.equations[:, :-1], np.maximum(-hull.equations[:, -1], 0.0)
        reach, farthest = wrenches.support(normals)
        shares = np.where(reach > 0.0, distances / np.where(reach > 0.0, reach, 1.0), 1.0)
        free_count = min(count - len(points) + 1, count_per_round)
        if free_count <= 0 or np.min(shares) >= 1.0 - EXACT:
            break
        chosen = select_separated(normals, np.argsort(shares)[:MOST_FACES], SEPARATION, free_count)
        points = np.concatenate([farthest[chosen], points])
    return InscribedPolytope(
        vertices=read_only(points),
        normals=read_only(normals),
        distances=read_only(distances),
        members=np.asarray(hull.simplices, dtype=np.intp),
        share=min(float(np.min(shares)), 1.0),
        torque_scale=float(torque_scale),
    )


def _wrench_hull(points: FloatArray) -> ConvexHull:
    """Return the convex hull of wrenches."""
    try:
        return ConvexHull(points)
    except QhullError as error:
        raise NlpgraspError(f"the inscribed polytope cannot be built: {str(error).splitlines()[0]}") from None


@dataclass(frozen=True)
class SteppedMu:
    """Result of the stepwise algorithm for mu: largest beta, last step and approximation errors.

    Parameters
    ----------
    beta : float
        All sampled wrenches, times beta, are in the polytope.
    step : float
        Times ``beta + step``, the wrench ``worst`` is not.
    worst : (d,) array
        That wrench of the task, newtons and newton-metres.
    wrenches : int
        Number of sampled task wrenches.
    task_share : float
        Error of the samples: the task times this is in their hull; 1 for a polytope.
    polytope_share : float
        Error of the polytope: ``G(B ∩ K)`` times this is in it; 0 if the origin is on its boundary.
    """

    beta: float
    step: float
    worst: FloatArray
    wrenches: int
    task_share: float
    polytope_share: float

    @property
    def bounds(self) -> Bounds:
        """Bounds on mu from the approximation errors of task and polytope, not certified.

        They are ``task_share beta`` and ``(beta + step) / polytope_share``.
        """
        upper = (self.beta + self.step) / self.polytope_share if self.polytope_share > 0.0 else np.inf
        return Bounds(self.task_share * self.beta, upper)


def mu_by_steps(
    grasp: Grasp,
    task: Task,
    rtol: float = 1e-3,
    vertices: int = VERTICES,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> SteppedMu:
    """Return mu by the paper's algorithm: increase beta while the task's wrenches stay in a polytope.

    The polytope is inscribed in ``G(B ∩ K)``. Ellipsoids are sampled at well-spread boundary wrenches; of polytopes all
    wrenches are used. Membership is tested by the distance from the polytope, [14] and [15] of the paper. When a step
    leaves it, the step is reduced to a tenth. For comparison only: ``mu`` is certified and faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    task : TaskEllipsoid or TaskPolytope
        As for ``mu``.
    rtol : float
        Last step relative to beta, greater than zero.
    vertices : int
        Of the polytope, as in ``inscribed_polytope``.
    force_budget : str or ForceBudget
        Bound on the finger forces.
    seed : int
        Of the polytope's directions.

    Returns
    -------
    SteppedMu
        With ``beta`` relative to the given task, and its errors.

    Raises
    ------
    InputError
        On other kinds of task, or another dimension; on numbers out of range.
    """
    require_grasp(grasp)
    rtol = number("rtol", rtol, above=0.0)
    integer("vertices", vertices, at_least=1)
    wrenches, task_share = _wrenches_of(task_for(task, grasp))
    arm = grasp.mean_arm
    polytope = inscribed_polytope(grasp, vertices, arm, force_budget=force_budget, seed=seed)
    scale = torque_factors(grasp, arm)
    scaled = wrenches * scale
    beta, step, wrench = _increase_beta(polytope.vertices, scaled, rtol)
    return SteppedMu(beta, step, wrench / scale, len(wrenches), task_share, polytope.share)


def _wrenches_of(task: Task) -> tuple[FloatArray, float]:
    """Return boundary wrenches (m, d) of a task, and a multiple of the task that their hull contains."""
    if isinstance(task, TaskPolytope):
        return task.wrenches[np.any(task.wrenches != 0.0, axis=1)], 1.0
    if not isinstance(task, TaskEllipsoid):
        raise InputError("task", task, "a TaskEllipsoid or a TaskPolytope")
    axes = np.linalg.svd(task.axes, full_matrices=False)  # of an ellipsoid with axes that are not orthogonal
    is_nonzero = 1e-12 * axes.S[0] < axes.S
    lengths = axes.S[is_nonzero, None] * axes.Vh[is_nonzero]
    u = directions(len(lengths), SHELLS)
    inradius = directions_inradius(len(lengths), SHELLS)
    return task.center + u @ lengths, inradius if task.is_centred else _off_centre_multiple(task, lengths, inradius)


def _off_centre_multiple(task: TaskEllipsoid, lengths: FloatArray, inradius: float) -> float:
    """Return a multiple of an off-centre ellipsoid that the hull of its samples contains, 0 if unknown.

    With the origin inside the samples' ellipsoid at ``|v| = rho < r`` (in units of the axes, r the inradius) the hull
    holds ``c + r L u``, hence ``(r - rho) / (1 - rho)`` times the ellipsoid.
    """
    coordinates = np.linalg.lstsq(lengths.T, -task.center, rcond=None)[0]
    remainder = lengths.T @ coordinates + task.center
    if np.linalg.norm(remainder) > 1e-9 * np.linalg.norm(task.center):
        return 0.0
    rho = float(np.linalg.norm(coordinates))
    return max(0.0, (inradius - rho) / (1.0 - rho)) if rho < 1.0 else 0.0


def _increase_beta(vertices: FloatArray, wrenches: FloatArray, rtol: float) -> tuple[float, float, FloatArray]:
    """Return the largest beta reached, the last step, and the wrench that left the polytope."""
    largest_beta = float(np.max(np.linalg.norm(vertices, axis=1)) / np.max(np.linalg.norm(wrenches, axis=1)))
    beta, step, worst_index = 0.0, FIRST_STEP * largest_beta, 0
    while True:
        index = _first_outside(vertices, (beta + step) * wrenches, worst_index)
        if index is None:
            beta += step
            continue
        worst_index = index
        if step <= rtol * max(beta, rtol * largest_beta):
            return beta, step, wrenches[worst_index]
        step *= FIRST_STEP


def _first_outside(vertices: FloatArray, wrenches: FloatArray, first: int) -> int | None:
    """Return the index of a wrench outside the hull of vertices; None if all are inside.

    The wrench with index ``first`` is tested first.
    """
    for i in [first, *(j for j in range(len(wrenches)) if j != first)]:
        if polytope_distance(vertices, wrenches[i]).outside:
            return i
    return None


@dataclass(frozen=True)
class PolytopeDistance:
    """Distance of a point from a polytope, with a certified lower bound.

    Parameters
    ----------
    distance : float
        From the point to ``nearest``, an upper bound of the true distance, in the unit of the points.
    lower : float
        Lower bound of the true distance, by a separating plane; 0 if none was found.
    nearest : (d,) array
        The nearest point of the polytope.
    direction : (d,) array
        From the nearest point to the point; unit length, zero where they are the same.
    """

    distance: float
    lower: float
    nearest: FloatArray
    direction: FloatArray

    @property
    def outside(self) -> bool:
        """Whether a separating plane proves that the point is outside."""
        return self.lower > 0.0


def polytope_distance(polytope: ArrayLike | Vertex, point: ArrayLike, most: int = MOST_STEPS) -> PolytopeDistance:
    """Return the distance of a point from a polytope, given by vertices or a support function.

    Parameters
    ----------
    polytope : (m, d) array or callable
        Its vertices, or a function that maps a direction y (d,) to the farthest point (d,) along y. That may also be of
        any other closed convex set: the method then ends at rounding, or after ``most`` steps.
    point : (d,) array
        The point.
    most : int
        Most steps, at least 1.

    Returns
    -------
    PolytopeDistance
        In the unit of the points.

    Raises
    ------
    InputError
        On shapes that do not match, NaN, or no vertices.
    """
    p = array("point", point, (None,))
    most = integer("most", most, at_least=1)
    vertex = polytope if callable(polytope) else _vertex_function(polytope, len(p))
    # the vertices in use, relative to the point; the nearest point is a mean of them
    V = np.array([_farthest_vertex(vertex, p) - p])
    weights = np.ones(1)
    x, lower, extent, first_vertex = V[0], 0.0, 0.0, V[0]
    for _ in range(most):
        size = float(np.linalg.norm(x))
        if size <= LEAST_WEIGHT * extent:
            break
        new = _farthest_vertex(vertex, -x) - p
        lower, extent = max(lower, float(x @ new) / size), max(extent, float(np.linalg.norm(new - first_vertex)))
        if x @ (x - new) <= GAP * size * extent:
            break
        if np.any(np.all(new == V, axis=1)):
            break
        V, weights = _nearest_of(np.concatenate([V, new[None]]), np.append(weights, 0.0))
        nearer = weights @ V
        if not nearer @ nearer < x @ x:  # rounding: no step gets any nearer
            break
        x = nearer
    size = float(np.linalg.norm(x))
    return PolytopeDistance(size, min(max(lower, 0.0), size), p + x, -x / size if size > 0.0 else np.zeros_like(x))


def _vertex_function(points: ArrayLike, d: int) -> Vertex:
    """Return a function for the farthest of some points along a direction."""
    rows = array("polytope", points, (None, d))
    if not len(rows):
        raise InputError("polytope", "no points", "at least one vertex")
    return lambda y: rows[int(np.argmax(rows @ y))]


def _farthest_vertex(vertex: Vertex, y: FloatArray) -> FloatArray:
    """Return the validated farthest vertex along a direction."""
    return array("polytope", vertex(y), y.shape)


def _nearest_of(V: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the vertices and weights of the point of their hull nearest to the origin (Wolfe's minor cycle)."""
    while True:
        steps = np.linalg.lstsq((V[1:] - V[0]).T, -V[0], rcond=None)[0]
        affine_weights = np.concatenate([[1.0 - steps.sum()], steps])  # of the nearest point of their affine hull
        if np.all(affine_weights > LEAST_WEIGHT):
            return V, affine_weights / affine_weights.sum()
        is_negative = affine_weights <= LEAST_WEIGHT
        drop = weights[is_negative] - affine_weights[is_negative]
        share = np.min(np.where(drop > 0.0, weights[is_negative] / np.where(drop > 0.0, drop, 1.0), 0.0))
        weights = (1.0 - min(share, 1.0)) * weights + min(share, 1.0) * affine_weights
        is_kept = weights > LEAST_WEIGHT
        if is_kept.all():
            is_kept[int(np.argmin(weights))] = False
        V, weights = V[is_kept], weights[is_kept] / weights[is_kept].sum()
