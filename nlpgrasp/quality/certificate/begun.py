"""A certificate that was begun: as far as a look at a grasp needed it, and on to its bounds where they are asked."""

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
    """The sandwich of a grasp and a task, narrowed as far as was of use so far.

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
        """Return the sandwich narrowed to a tolerance, None where rank alone proves that ``mu = 0``."""
        problem, _ = conditioned(WrenchSet.of(grasp, budget), task)
        return None if problem is None else cls(grasp, task, budget, problem, narrowed(problem, rtol))

    def is_of(self, grasp: Grasp, budget: ForceBudget) -> bool:
        """Return whether it is the certificate of a grasp with these very contacts under this very budget."""
        mine, same = self.grasp, budget is self.budget
        return same and np.array_equal(mine.points, grasp.points) and np.array_equal(mine.normals, grasp.normals)

    def bounds(self, rtol: float, deadline: float | None = None) -> Bounds:
        """Return certified bounds, as ``mu`` does, from where the sandwich stands."""
        found = sandwich(self.containment, rtol, 0, deadline, self.sandwich)
        return found.of_measure(self.task.measure, self.task.paper_beta)
