"""Resumable certificate of mu: coarse bounds first, tightened on demand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.certificate.containment import Containment, conditioned
from nlpgrasp.quality.certificate.sandwich import Sandwich, narrowed, sandwich
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.tasks import Task


@dataclass(frozen=True)
class Begun:
    """A resumable certificate: the partly tightened sandwich of a grasp and a task.

    Parameters
    ----------
    grasp : Grasp
    task : Task
    budget : ForceBudget
    containment : Containment
        Of the task in the grasp's wrench set.
    sandwich : Sandwich
    """

    grasp: Grasp
    task: Task
    budget: ForceBudget
    containment: Containment
    sandwich: Sandwich

    @classmethod
    def of(cls, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float) -> Begun | None:
        """Return the certificate tightened to a tolerance, None if rank alone proves ``mu = 0``."""
        problem, _ = conditioned(WrenchSet.of(grasp, budget), task)
        return None if problem is None else cls(grasp, task, budget, problem, narrowed(problem, rtol))

    def is_of(self, grasp: Grasp, budget: ForceBudget) -> bool:
        """Return whether it belongs to a grasp with identical contact points and normals and the same budget object."""
        mine, same = self.grasp, budget is self.budget
        return same and np.array_equal(mine.points, grasp.points) and np.array_equal(mine.normals, grasp.normals)

    def bounds(self, rtol: float, deadline: float | None = None) -> Bounds:
        """Return certified bounds, as ``mu`` does, resuming from the current sandwich."""
        found = sandwich(self.containment, rtol, 0, deadline, self.sandwich)
        return found.of_measure(self.task.measure, self.task.paper_beta)
