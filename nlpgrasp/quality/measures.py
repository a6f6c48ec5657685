"""Quality measures delta and mu with certified bounds (Sections 3.1 and 3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import integer, number
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.certificate.containment import conditioned
from nlpgrasp.quality.certificate.sandwich import sandwich
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.quality.forces.bilateral import bilateral_ellipsoid
from nlpgrasp.tasks import Task, TaskEllipsoid


@overload
def mu(
    grasp: Grasp,
    task: Task,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
    deadline: float | None = None,
) -> Bounds: ...


@overload
def mu(
    grasp: GraspStack,
    task: Task,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
    deadline: float | None = None,
) -> StackBounds: ...


def mu(
    grasp: Grasp | GraspStack,
    task: Task,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
    deadline: float | None = None,
) -> Bounds | StackBounds:
    """Return the task-oriented quality: mu (3.3-4a) if the task is centred, else mu-tilde (3.3-4b).

    Both are the largest alpha with ``alpha A`` inside ``G(B n K)``: unit force (in terms of the force budget) exerts
    every wrench of the task times alpha; the whole task needs force ``1 / alpha``. For a centred ellipsoid alpha times
    the task's ``beta`` is the paper's mu, the beta of the largest ``A_beta`` inside.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    task : Task
        About the same torque origin as the grasp.
    rtol : float
        Relative width at which to stop, greater than zero.
    force_budget : str or ForceBudget
        ``"l2"`` (the paper's), ``"per_finger"``, ``"shared"``, ``"per_finger_size"`` or joint-torque limits.
    seed : int
        Of the search directions; the bounds hold for any.
    deadline : float, optional
        ``time.monotonic()`` value, seconds, after which wider bounds are accepted.

    Returns
    -------
    Bounds
        Certified: ``lower <= mu <= upper``. With ``upper == 0``, ``worst_direction`` is the proof. ``kind`` says
        which of the two measures it is, ``beta`` is the interval in the paper's sense. For a stack, arrays of them.

    Raises
    ------
    InputError
        When the task's dimension is not the grasp's, rtol is not positive, or the budget does not fit.
    """
    require_grasp(grasp, stack=True)
    task = task_for(task, grasp)
    seed = integer("seed", seed, at_least=0, at_most=2**63 - 1)
    deadline = None if deadline is None else number("deadline", deadline)
    if isinstance(grasp, GraspStack):
        return StackBounds.of(
            [mu(g, task, rtol, force_budget=force_budget, seed=seed, deadline=deadline) for g in grasp]
        )
    rtol = number("rtol", rtol, above=0.0)
    found = _certified(grasp, task, rtol, force_budget, seed, deadline)
    return found.of_measure(task.measure, task.paper_beta)


def _certified(
    grasp: Grasp, task: Task, rtol: float, force_budget: str | ForceBudget, seed: int, deadline: float | None
) -> Bounds:
    """Return the certified bounds of one grasp."""
    wrenches = WrenchSet.of(grasp, force_budget)
    exact = bilateral_ellipsoid(wrenches, task)
    if exact is not None:
        return exact
    problem, proof = conditioned(wrenches, task)
    if problem is None:
        return Bounds(0.0, 0.0, proof)
    return sandwich(problem, rtol, seed, deadline)


@overload
def delta(
    grasp: Grasp, torque_scale: float = 1.0, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2"
) -> Bounds: ...


@overload
def delta(
    grasp: GraspStack, torque_scale: float = 1.0, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2"
) -> StackBounds: ...


def delta(
    grasp: Grasp | GraspStack,
    torque_scale: float = 1.0,
    rtol: float = 0.01,
    *,
    force_budget: str | ForceBudget = "l2",
) -> Bounds | StackBounds:
    """Return delta: the radius of the largest ball about the origin inside ``G(B n K)``, (3.1-1b).

    With bilateral contacts only (``K = R^n``) and the L2 budget it is the smallest singular value of G, (3.1-1a). With
    ``force_budget="shared"`` it is Ferrari and Canny's epsilon, of the exact friction cones.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres. A torque counts as the force ``torque / torque_scale``; delta depends on it and on the torque origin
        (Remark 6), so quote both with any value.
    rtol : float
        Relative width at which to stop.
    force_budget : str or ForceBudget
        Bound on the finger forces.

    Returns
    -------
    Bounds
        Certified, in newtons per unit of finger force. For a stack, arrays of them.
    """
    require_grasp(grasp, stack=True)
    found = mu(grasp, ball(grasp.dimension, torque_scale), rtol, force_budget=force_budget)
    return replace(found, torque_scale=float(torque_scale), kind="delta", task_beta=None)


def ball(dimension: int, torque_scale: float) -> TaskEllipsoid:
    """Return the unit ball of wrenches as a task, with torques divided by ``torque_scale``."""
    scale = number("torque_scale", torque_scale, above=0.0)
    forces = 2 if dimension == 3 else 3
    return TaskEllipsoid(np.array([1.0] * forces + [scale] * (dimension - forces)))
