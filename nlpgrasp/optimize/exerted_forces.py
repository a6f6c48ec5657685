"""Least finger forces of a grasp: for the task scaled by its quality, and for the task as stated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, finger_forces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.force_records import ForcesNeeded


@dataclass(frozen=True)
class ExertedForces:
    """Least finger forces for some of the task's extreme wrenches.

    Parameters
    ----------
    forces : tuple of (wrench, forces)
        Wrenches times the certified quality (d,), and finger forces (k, space), newtons.
    moments : tuple of (k, d - space) array
        With them, newton-metres; empty where no contact exerts any.
    needed : ForcesNeeded or None
        For the task as it was given; None of a grasp whose quality is not certified above 0.
    """

    forces: tuple[tuple[FloatArray, FloatArray], ...]
    moments: tuple[FloatArray, ...]
    needed: ForcesNeeded | None


def least_forces(problem: GraspProblem, grasp: Grasp, budget: ForceBudget, bounds: Bounds) -> ExertedForces:
    """Return the least forces, and moments if any, for the task's extreme wrenches, and those of the whole task.

    The hardest wrench is the one, of these and of the one that the task asks for in the certificate's worst direction,
    that takes most of the budget.

    Parameters
    ----------
    problem : GraspProblem
    grasp : Grasp
    budget : ForceBudget
        In the posture found.
    bounds : Bounds
        Certified mu.
    """
    share, space, ends = bounds.lower, grasp.space, problem.task.ends()
    wrenches, y = share * ends, bounds.worst_direction
    if y is not None:
        wrenches = np.concatenate([wrenches, share * problem.task.support(y[None])[1]])
    found = finger_forces(grasp, wrenches, force_budget=budget)
    exerted = np.stack([grasp.contact_wrenches(x) for x in found.forces])
    forces, moments = exerted[:, :, :space], exerted[:, :, space:]
    turning = any(axis >= space for m in grasp.contacts for axis in m.axes(space))
    able = np.flatnonzero(found.feasible)
    listed = able[able < len(ends)]
    told = tuple((wrenches[i], forces[i]) for i in listed)
    turned = tuple(moments[i] for i in listed) if turning else ()
    if share <= 0.0 or not able.size:
        return ExertedForces(told, turned, None)
    hardest = int(able[np.argmax(found.used[able])])
    turn = moments[hardest] / share if turning else None
    whole = [forces[i] / share for i in listed]
    needed = ForcesNeeded.of(grasp, wrenches[hardest] / share, forces[hardest] / share, turn, whole, bounds)
    return ExertedForces(told, turned, replace(needed, within=needed.is_within(problem.max_force)))
