"""Quality measures of a given grasp, with certified bounds (Sections 3.1 and 3.3)."""

from __future__ import annotations

import numpy as np

from nlpgrasp.errors import InputError
from nlpgrasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import conditioned
from nlpgrasp.quality.sandwich import sandwich
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task, TaskEllipsoid
from nlpgrasp.validation import number


def mu(grasp: Grasp, task: Task, rtol: float = 0.01, *, seed: int = 0, deadline: float | None = None) -> Bounds:
    """Return the task-oriented quality: mu (3.3-4a) when the task is centred, mu-tilde (3.3-4b) otherwise.

    Both are the largest alpha with ``alpha A`` inside ``G(B n K)``: unit force (in the L2 norm of all finger
    forces) then resists every wrench of the task times alpha; the whole task needs force ``1 / alpha``. For a
    centred ellipsoid alpha is the paper's beta, in units of the semi-axes as given.

    Parameters
    ----------
    grasp : Grasp
    task : Task
        About the same torque origin as the grasp.
    rtol : float
        Relative width at which to stop, greater than zero.
    seed : int
        Of the search directions; the bounds hold whatever it is.
    deadline : float, optional
        ``time.monotonic()`` value after which wider bounds are accepted.

    Returns
    -------
    Bounds
        Certified: ``lower <= mu <= upper``. With ``upper == 0``, ``worst_direction`` is the proof.

    Raises
    ------
    InputError
        When the task's dimension is not the grasp's, or rtol is not positive.
    """
    rtol = number("rtol", rtol, above=0.0)
    if task.dimension != grasp.dimension:
        raise InputError("task", f"dimension {task.dimension}", f"the grasp's wrench dimension {grasp.dimension}")
    problem, proof = conditioned(WrenchSet.of(grasp), task)
    if problem is None:
        return Bounds(0.0, 0.0, proof)
    bounds = sandwich(problem, rtol, seed, deadline)
    worst = bounds.worst_direction
    direction = None if worst is None else problem.original(worst)
    return Bounds(bounds.lower, bounds.upper, direction)


def delta(grasp: Grasp, torque_scale: float = 1.0, rtol: float = 0.01) -> Bounds:
    """Return delta (3.1-1b): the radius of the largest ball about the origin inside ``G(B n K)``.

    Parameters
    ----------
    grasp : Grasp
    torque_scale : float
        Metres. A torque counts as the force ``torque / torque_scale``; delta depends on it and on the torque
        origin (Remark 6), so both belong with any value that is quoted.
    rtol : float
        Relative width at which to stop.

    Returns
    -------
    Bounds
        Certified, in newtons per unit of finger force.
    """
    scale = number("torque_scale", torque_scale, above=0.0)
    forces = 2 if grasp.space == 2 else 3
    ball = TaskEllipsoid(np.array([1.0] * forces + [scale] * (grasp.dimension - forces)))
    return mu(grasp, ball, rtol)
