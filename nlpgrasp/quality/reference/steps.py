"""Reference algorithm for mu by increments of beta (Section 3.4, (3.3-4))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.directions import directions, inradius
from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.certificate.units import over_length
from nlpgrasp.quality.reference.distance import polytope_distance
from nlpgrasp.quality.reference.faces import VERTICES, inscribed_polytope
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope

FIRST = 0.1  # first step, of the largest possible beta; factor of later steps
SHELLS = 2


@dataclass(frozen=True)
class SteppedMu:
    """Result of the increments: largest beta, last step and approximation errors.

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
        Error of the polytope: ``G(B n K)`` times this is in it; 0 if the origin is on its boundary.
    """

    beta: float
    step: float
    worst: FloatArray
    wrenches: int
    task_share: float
    polytope_share: float

    @property
    def bounds(self) -> Bounds:
        """Bounds on mu from both errors, ``task_share beta`` to ``(beta + step) / polytope_share``, not certified."""
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

    The polytope is inscribed in ``G(B n K)``. Ellipsoids are sampled at well-spread boundary wrenches; of polytopes all
    wrenches are used. Membership is tested by the distance from the polytope, [14] and [15] of the paper. When a step
    leaves it, the step is reduced to a tenth. For comparison only: ``mu`` is certified and faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    task : TaskEllipsoid or TaskPolytope
        About the same torque origin as the grasp.
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
    scale = over_length(grasp, arm)
    scaled = wrenches * scale
    beta, step, worst = _stepped(polytope.vertices, scaled, rtol)
    return SteppedMu(beta, step, worst / scale, len(wrenches), task_share, polytope.share)


def _wrenches_of(task: Task) -> tuple[FloatArray, float]:
    """Return boundary wrenches (m, d) of a task, and the share of the task in their hull."""
    if isinstance(task, TaskPolytope):
        return task.wrenches[np.any(task.wrenches != 0.0, axis=1)], 1.0
    if not isinstance(task, TaskEllipsoid):
        raise InputError("task", task, "a TaskEllipsoid or a TaskPolytope")
    axes = np.linalg.svd(task.axes, full_matrices=False)  # of an ellipsoid with axes that are not orthogonal
    kept = 1e-12 * axes.S[0] < axes.S
    lengths = axes.S[kept, None] * axes.Vh[kept]
    u = directions(len(lengths), SHELLS)
    inside = inradius(len(lengths), SHELLS)
    return task.center + u @ lengths, inside if task.is_centred else _off_centre(task, lengths, inside)


def _off_centre(task: TaskEllipsoid, lengths: FloatArray, inside: float) -> float:
    """Return the share of an off-centre ellipsoid in the hull of its samples, 0 if unknown.

    With the origin inside the samples' ellipsoid at ``|v| = rho < inside`` (in units of the axes) the hull holds
    ``c + inside L u``, hence the share ``(inside - rho) / (1 - rho)`` of the whole.
    """
    coordinates = np.linalg.lstsq(lengths.T, -task.center, rcond=None)[0]
    off = lengths.T @ coordinates + task.center
    if np.linalg.norm(off) > 1e-9 * np.linalg.norm(task.center):
        return 0.0
    rho = float(np.linalg.norm(coordinates))
    return max(0.0, (inside - rho) / (1.0 - rho)) if rho < 1.0 else 0.0


def _stepped(vertices: FloatArray, wrenches: FloatArray, rtol: float) -> tuple[float, float, FloatArray]:
    """Return beta, the last step, and the wrench that left the polytope."""
    most = float(np.max(np.linalg.norm(vertices, axis=1)) / np.max(np.linalg.norm(wrenches, axis=1)))
    beta, step, worst = 0.0, FIRST * most, 0
    while True:
        outside = _first_outside(vertices, (beta + step) * wrenches, worst)
        if outside is None:
            beta += step
            continue
        worst = outside
        if step <= rtol * max(beta, rtol * most):
            return beta, step, wrenches[worst]
        step *= FIRST


def _first_outside(vertices: FloatArray, wrenches: FloatArray, first: int) -> int | None:
    """Return the index of a wrench outside the hull of vertices, testing a given one first; None if all are inside."""
    for i in [first, *(j for j in range(len(wrenches)) if j != first)]:
        if polytope_distance(vertices, wrenches[i]).outside:
            return i
    return None
