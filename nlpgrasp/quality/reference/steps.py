"""mu by increments of beta (Section 3.4): the paper's procedure for (3.3-4)."""

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

FIRST = 0.1  # of the largest beta that could be: the first step
SHELLS = 2


@dataclass(frozen=True)
class SteppedMu:
    """The largest beta that was stepped to.

    Parameters
    ----------
    beta : float
        All wrenches looked at, times beta, are in the polytope.
    step : float
        Times ``beta + step`` one of them is not: ``worst``.
    worst : (d,) array
        That wrench of the task, newtons and newton-metres.
    wrenches : int
        How many wrenches of the task were looked at.
    task_share : float
        Their own error: the task times this is in their hull, 1 where they are all there is to it.
    polytope_share : float
        That of the polytope: ``G(B n K)`` times this is in it; 0 where the origin is on its boundary.
    """

    beta: float
    step: float
    worst: FloatArray
    wrenches: int
    task_share: float
    polytope_share: float

    @property
    def bounds(self) -> Bounds:
        """What both errors leave of mu: ``task_share beta`` to ``(beta + step) / polytope_share``, not certified."""
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
    """Return mu as the paper computes it: beta grows step by step while the task's wrenches stay in a polytope.

    The polytope is inscribed in ``G(B n K)``; of ellipsoids well-spread wrenches of the boundary are looked at, of
    polytopes all. Whether a wrench is in it is asked of the distance from it, [14] and [15] of the paper. Where a step
    leaves it the next ones are a tenth of it. A reference method, for comparison: ``mu`` is certified and faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    task : TaskEllipsoid or TaskPolytope
        About the same torque origin as the grasp.
    rtol : float
        Of beta: the last step, greater than zero.
    vertices : int
        Of the polytope, as in ``inscribed_polytope``.
    force_budget : str or ForceBudget
        What a unit of finger force means.
    seed : int
        Of the polytope's directions.

    Returns
    -------
    SteppedMu
        With ``beta`` as a multiple of the task as given, and how far off it may be.

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
    """Return wrenches of a task's boundary, (m, d), and the share of the task that is in their hull."""
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
    """Return the share of an ellipsoid off the origin that is in the hull of its samples: 0 where that is unknown.

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
    """Return beta, the last step, and the wrench that left the polytope with it."""
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
    """Return a wrench outside the hull of vertices, the one that was outside before asked first."""
    for i in [first, *(j for j in range(len(wrenches)) if j != first)]:
        if polytope_distance(vertices, wrenches[i]).outside:
            return i
    return None
