"""Least grip force of a two-jaw gripper for a task, certified.

A gripper that is set to F presses both jaws with F. Its drive couples the jaws, so a load along the closing line adds
to one jaw's normal force what it takes off the other's; by virtual work their mean remains F. The gripper holds the
wrench w where

    G x = w,    x in K,    f_n,0 + f_n,1 = 2 F,

and where the contacts can press against each other it also holds it with every larger F: internal forces add to x. The
least F for a wrench is half the least sum of normal forces, and that for a task is ``1 / (2 mu)`` with mu under the
shared budget.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_friction import can_press
from nlpgrasp.quality.measures import mu
from nlpgrasp.tasks import Task

BUDGET = "shared"  # force budget that counts the sum of normal forces
NO_FORCE = Bounds(0.0, np.inf)  # grip force where none is known to hold the task


def least_grip(grasp: Grasp, task: Task, rtol: float = 0.01, friction_loss: float = 0.0, *, seed: int = 0) -> Bounds:
    """Return the least grip force with which two jaws hold every wrench of a task, newtons.

    Parameters
    ----------
    grasp : Grasp
        Of two contacts.
    task : Task
    rtol : float
        Relative width of the interval.
    friction_loss : float
        Share of every friction coefficient that is lost, from 0 to below 1.
    seed : int
        Of the certificate's directions.

    Returns
    -------
    Bounds
        Upper bound infinite where some wrench is held by no force, or the contacts cannot press against each other.
    """
    weaker = grasp.with_friction(1.0 - friction_loss) if friction_loss else grasp
    quality = mu(weaker, task, rtol, force_budget=BUDGET, seed=seed)
    if quality.lower <= 0.0 or not can_press(weaker):
        return NO_FORCE
    return quality.reciprocal(0.5)
