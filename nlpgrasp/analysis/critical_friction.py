"""Critical friction of a grasp, with the force that holds the task at frictions around it."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.formatting import format_upper
from nlpgrasp.quality.critical_friction import LARGEST, HoldingForce, common_friction
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.analysis_records import CriticalFriction, ForceAtFriction
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.task_set import is_sampled

COUNT = 6  # frictions of the curve
RTOL = 0.02  # relative width of its forces, and of the critical friction


def critical_friction(grasp: Grasp, task: Task, holding: HoldingForce) -> CriticalFriction | None:
    """Return the critical friction of a grasp and its force curve.

    The curve goes from half the contacts' friction, or the critical friction where that is more, to twice the larger
    of both, at frictions of two digits.

    Returns
    -------
    CriticalFriction or None
        None for a task whose function is unknown, and for a budget whose support functions are conic programs.

    Raises
    ------
    InputError
        When the contacts have no friction, or different coefficients.
    """
    friction = common_friction(grasp.contacts)
    if is_sampled(task) or holding.budget.at(grasp.frames, grasp.contacts).costly:
        return None
    least, curve = holding.critical_friction(grasp, task, RTOL), list[ForceAtFriction]()
    if np.isinf(least.upper):  # without a proof that the largest friction is too little nothing is stated
        return CriticalFriction() if least.lower == LARGEST else None
    lowest = max(0.5 * friction, least.upper)
    for value in np.geomspace(lowest, 2.0 * max(friction, lowest), COUNT):
        at = float(format_upper(float(value), 2))
        force = holding.least(grasp.with_friction(at / friction), task, RTOL)
        if at != friction and np.isfinite(force.upper):
            curve.append(ForceAtFriction(at, force))
    return CriticalFriction(least, tuple(curve))
