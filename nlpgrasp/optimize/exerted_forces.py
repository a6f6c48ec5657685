"""Least finger forces of a grasp for the task scaled by the grasp's quality, and for the task as given."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, finger_forces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.force_records import ForcesNeeded


@dataclass(frozen=True)
class ExertedForces:
    """Least finger forces and moments for extreme wrenches of a task.

    Parameters
    ----------
    forces : tuple of (wrench, forces)
        Wrenches times the certified quality (d,), and finger forces (k, space), newtons.
    moments : tuple of (k, d - space) array
        Moments of the fingers, newton-metres; empty where no contact exerts any.
    needed : ForcesNeeded or None
        For the task as stated; None for a grasp whose quality is not certified above 0.
    """

    forces: tuple[tuple[FloatArray, FloatArray], ...]
    moments: tuple[FloatArray, ...]
    needed: ForcesNeeded | None


def compute_exerted_forces(problem: GraspProblem, grasp: Grasp, budget: ForceBudget, bounds: Bounds) -> ExertedForces:
    """Return the least finger forces and moments for the task's extreme wrenches.

    The wrenches are scaled by the certified quality; ``needed`` is for the task as given. The hardest wrench is the one
    that takes most of the budget, among these and the task's extreme wrench in the certificate's worst direction.

    Parameters
    ----------
    problem : GraspProblem
    grasp : Grasp
    budget : ForceBudget
        In the hand's posture.
    bounds : Bounds
        Certified mu.
    """
    quality, space, ends = bounds.lower, grasp.space, problem.task.ends()
    wrenches, y = quality * ends, bounds.worst_direction
    if y is not None:
        wrenches = np.concatenate([wrenches, quality * problem.task.support(y[None])[1]])
    least = finger_forces(grasp, wrenches, force_budget=budget)
    exerted = grasp.contact_wrenches(least.forces)
    forces, moments = exerted[:, :, :space], exerted[:, :, space:]
    has_moments = any(axis >= space for m in grasp.contacts for axis in m.axes(space))
    feasible = np.flatnonzero(least.feasible)
    listed = feasible[feasible < len(ends)]
    by_wrench = tuple((wrenches[i], forces[i]) for i in listed)
    listed_moments = tuple(moments[i] for i in listed) if has_moments else ()
    if quality <= 0.0 or not feasible.size:
        return ExertedForces(by_wrench, listed_moments, None)
    hardest = int(feasible[np.argmax(least.used[feasible])])
    moment = moments[hardest] / quality if has_moments else None
    scaled = [forces[i] / quality for i in listed]
    needed = ForcesNeeded.of(grasp, wrenches[hardest] / quality, forces[hardest] / quality, moment, scaled, bounds)
    limit = None if isinstance(problem.hand, ParallelJaw) else problem.max_force  # of jaws: that of their grip force
    return ExertedForces(by_wrench, listed_moments, replace(needed, within=needed.is_within(limit)))
