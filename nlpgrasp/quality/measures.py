"""Quality measures delta, mu, mu-tilde and mu_1 with certified bounds (Sections 3.1 and 3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets import force_budget as find_budget
from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.sandwich import no_work, sandwich
from nlpgrasp.quality.screening import fixed_force_set
from nlpgrasp.quality.stack_certificates import certify_side_by_side
from nlpgrasp.quality.wrench_set import WrenchSet, numerical_rank
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskSet

FINEST = 5e-3  # least relative width for certificates side by side: narrower ones need many vertices


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

    Both are the largest alpha with ``alpha A`` inside ``G(B ∩ K)``: unit force (in terms of the force budget) exerts
    every wrench of the task times alpha; the whole task needs force ``1 / alpha``. For a centred ellipsoid alpha times
    the task's ``beta`` is the paper's mu, the beta of the largest ``A_beta`` inside.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    task : Task
        Converted from its torque origin to the grasp's; without one it is about the grasp's.
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
    seed = integer("seed", seed, at_least=0, at_most=2**63 - 1)
    deadline = None if deadline is None else number("deadline", deadline)
    rtol = number("rtol", rtol, above=0.0)
    if isinstance(grasp, GraspStack):
        return _certify_stack(grasp, task_for(task, grasp), rtol, force_budget, seed, deadline)
    return replace(certify(grasp, task, rtol, force_budget, seed, deadline), vertices=None)


def _certify_stack(
    stack: GraspStack, task: Task, rtol: float, budget: str | ForceBudget, seed: int, deadline: float | None
) -> StackBounds:
    """Return the certified bounds of each grasp of a stack, computed side by side where possible."""
    force_bound = find_budget(budget)
    force_bound.check(stack.contacts, stack.space)
    bounds: list[Bounds | None] = [None] * len(stack)
    is_alike = not force_bound.depends_on_frames and any(c.unilateral for c in stack.contacts)
    if is_alike and deadline is None and rtol >= FINEST and len(stack) > 1:
        bounds = certify_side_by_side(stack, task, rtol, fixed_force_set(stack, force_bound), seed)
    certified = [
        certify(stack[i], task, rtol, budget, seed, deadline) if known is None else known
        for i, known in enumerate(bounds)
    ]
    return StackBounds.of([replace(b, vertices=None, kind=task.measure, task_beta=task.paper_beta) for b in certified])


def certify(
    grasp: Grasp,
    task: Task,
    rtol: float,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
    deadline: float | None = None,
) -> Bounds:
    """Return certified bounds on mu of one grasp, as ``mu``, with the vertices that prove the lower end."""
    task = task_for(task, grasp)
    wrenches = WrenchSet.of(grasp, force_budget)
    bounds = bound_in_closed_form(wrenches, task)
    if bounds is None:
        problem, y = make_containment(wrenches, task)
        if problem is not None:
            bounds = sandwich(problem, rtol, seed, deadline)
        else:
            bounds = Bounds(0.0, 0.0) if y is None else no_work(wrenches, task, y)
    return bounds.of_measure(task.measure, task.paper_beta)


def bound_in_closed_form(wrenches: WrenchSet, task: Task) -> Bounds | None:
    """Return bounds on mu where wrench set and task are centred ellipsoids, else None.

    mu is then the least ``|G^T y| / |L^T y|``. With ``G = U S V^T`` and ``y = U S^-1 v`` it is one over the largest
    singular value of ``L^T U S^-1``; for a ball of wrenches the smallest singular value of G. Singular values are off
    by at most a few ``d eps`` times the largest (Golub and Van Loan 2013, Section 8.6): the guard counts dozens.
    """
    if not (wrenches.is_ellipsoid and isinstance(task, TaskEllipsoid)):
        return None
    scales = np.linalg.norm(wrenches.G, axis=1)
    if not task.is_centred or np.any(scales == 0.0):
        return None
    U, S, _ = np.linalg.svd(wrenches.G / scales[:, None])
    if numerical_rank(S) < len(U):
        return None
    _, values, right = np.linalg.svd((task.axes / scales) @ U / S)
    direction = (U @ (right[0] / S)) / scales
    guard = 1e-14 * len(U) * (S[0] + np.linalg.norm(task.axes / scales) / values[0]) / S[-1]
    ratio = float(1.0 / values[0])
    return Bounds(float(ratio * (1.0 - guard)), float(ratio * (1.0 + guard)), direction / np.linalg.norm(direction))


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
    """Return delta: the radius of the largest ball about the origin inside ``G(B ∩ K)``, (3.1-1b).

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
    ball = unit_ball(grasp.dimension, torque_scale).given_about(grasp.torque_origin)
    bounds = mu(grasp, ball, rtol, force_budget=force_budget)
    return replace(bounds, torque_scale=float(torque_scale), kind="delta", task_beta=None)


def unit_ball(dimension: int, torque_scale: float) -> TaskEllipsoid:
    """Return the unit ball of wrenches as a task, with torques divided by ``torque_scale``."""
    scale = number("torque_scale", torque_scale, above=0.0)
    forces = 2 if dimension == 3 else 3
    return TaskEllipsoid(np.array([1.0] * forces + [scale] * (dimension - forces)))


def unit_ball_scale(task: Task) -> float | None:
    """Return the torque scale, metres, with which a task is the unit ball of wrenches; None for other tasks."""
    scale = float(task.axes[-1, -1]) if isinstance(task, TaskEllipsoid) else 0.0
    return scale if scale > 0.0 and task == unit_ball(task.dimension, scale) else None


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
    bounds = mu(grasp, task, rtol, force_budget=force_budget)
    return replace(bounds, kind="mu_tilde", task_beta=None)


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
        b, newtons and newton-metres, about the grasp's torque origin.
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

    rescaled = TaskSet(support, grasp.dimension).given_about(grasp.torque_origin)
    bounds = mu(grasp, rescaled, rtol, force_budget=force_budget)
    return replace(bounds, kind="mu_1", task_beta=None)


def support(
    item: Grasp | Task, directions: ArrayLike, *, force_budget: str | ForceBudget = "l2"
) -> tuple[FloatArray, FloatArray]:
    """Return the support function of a grasp's wrench set ``G(B ∩ K)`` (3.4-5), or of a task, with maximisers.

    Parameters
    ----------
    item : Grasp or Task
        Its wrench set, or the task itself, is the set whose support is evaluated.
    directions : (m, d) array
        Directions of wrench space, not necessarily of unit length.
    force_budget : str or ForceBudget
        Of a grasp, as for ``mu``.

    Returns
    -------
    values, wrenches : (m,) and (m, d) arrays
        ``phi(y)``, the largest ``<y, w>`` over the set, and a wrench that attains it, newtons and newton-metres.

    Raises
    ------
    InputError
        When the directions' dimension is not that of the wrenches.
    """
    if not isinstance(item, Grasp | Task):
        raise InputError("item", item, "a Grasp or a Task")
    y = array("directions", directions, (None, item.dimension))
    return item.support(y) if isinstance(item, Task) else WrenchSet.of(item, force_budget).support(y)


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
