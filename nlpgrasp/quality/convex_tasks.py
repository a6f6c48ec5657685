"""Quality measures mu-tilde and mu_1 for convex tasks, not necessarily centred (Section 3.3.2)."""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.measures import mu
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskSet


@overload
def mu_tilde(grasp: Grasp, task: Task, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2") -> Bounds: ...


@overload
def mu_tilde(
    grasp: GraspStack, task: Task, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2"
) -> StackBounds: ...


def mu_tilde(
    grasp: Grasp | GraspStack, task: Task, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2"
) -> Bounds | StackBounds:
    """Return mu-tilde (3.3-4b): the reciprocal of the least finger force that exerts every task wrench.

    The same number as ``mu``, which is relative to the given task; the paper's mu of a centred ``A_beta`` is beta times
    it (``mu(...).beta``).

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    task : Task
        Any convex set of wrenches that the fingers are to exert.
    rtol : float
        Relative width at which to stop.
    force_budget : str or ForceBudget
        As for ``mu``.

    Returns
    -------
    Bounds
        Certified. For a stack, arrays of them.
    """
    found = mu(grasp, task, rtol, force_budget=force_budget)
    return replace(found, kind="mu_tilde", task_beta=None)


@overload
def mu_1(
    grasp: Grasp,
    task: Task,
    center: ArrayLike,
    scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
) -> Bounds: ...


@overload
def mu_1(
    grasp: GraspStack,
    task: Task,
    center: ArrayLike,
    scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
) -> StackBounds: ...


def mu_1(
    grasp: Grasp | GraspStack,
    task: Task,
    center: ArrayLike,
    scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
) -> Bounds | StackBounds:
    """Return mu_1 (3.3-9): mu-tilde of ``b + lambda_0 (C - b)``, a convex task rescaled about a point.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    task : Task
        C, any convex set of wrenches.
    center : (d,) array
        b, newtons and newton-metres.
    scale : float
        lambda_0, greater than zero; if mu_1 > 0 is to imply stability, large enough for the rescaled set to contain the
        origin.
    rtol : float
        Relative width at which to stop.
    force_budget : str or ForceBudget
        As for ``mu``.

    Returns
    -------
    Bounds
        Certified. For a stack, arrays of them.
    """
    require_grasp(grasp, stack=True)
    task = task_for(task, grasp)
    b = array("center", center, (grasp.dimension,))
    factor = number("scale", scale, above=0.0)

    def support(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, maximisers = task.support(y)
        shift = y @ b
        return shift + factor * (values - shift), b + factor * (maximisers - b)

    found = mu(grasp, TaskSet(support, grasp.dimension), rtol, force_budget=force_budget)
    return replace(found, kind="mu_1", task_beta=None)


def equivalence_constants(task: TaskEllipsoid) -> tuple[float, float]:
    """Return the equivalence constants of (3.3-8): ``K_1 mu_tilde <= mu <= K_2 mu_tilde`` for every grasp.

    Here mu is the paper's (3.3-4a), the beta of the largest ``A_beta`` of the task's ellipsoid E about the origin, and
    mu-tilde that of the task itself, ``c + E`` (3.3-4b). The paper states it for centred tasks: mu is then the task's
    ``beta`` times mu-tilde, and both constants are ``beta``, which is 1 where none was given. With
    ``s = ||L^+ c||``, how far the centre c is out in units of E, ``(1 - s) E`` is inside ``c + E``, which is inside
    ``(1 + s) E``: K_1 is ``beta max(0, 1 - s)`` and K_2 is ``beta (1 + s)``. K_2 is infinite where c is out of the span
    of a flat ellipsoid.

    Parameters
    ----------
    task : TaskEllipsoid
        ``c + E``.

    Returns
    -------
    K_1, K_2 : float
        Dimensionless.
    """
    if not isinstance(task, TaskEllipsoid):
        raise InputError("task", task, "a TaskEllipsoid")
    local, *_ = np.linalg.lstsq(task.axes.T, task.center, rcond=None)
    if np.linalg.norm(task.axes.T @ local - task.center) > 1e-9 * max(float(np.linalg.norm(task.center)), 1e-300):
        return 0.0, float("inf")
    s = float(np.linalg.norm(local))
    return task.beta * max(0.0, 1.0 - s), task.beta * (1.0 + s)
