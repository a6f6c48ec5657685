"""Units of the solver: lengths over the body's size, forces over the budget's unit, beta over the task's size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem


@dataclass(frozen=True)
class Scaling:
    """Typical sizes of a problem's variables: the solver sees each variable less its offset, over its size.

    Parameters
    ----------
    origin : (space,) array
        Torque origin, metres: the solver's positions are counted from it.
    length : float
        The body's characteristic length, metres.
    task : float
        Size of the task's wrenches, newtons, moments counted over ``length``.
    force : float
        Newtons a solver unit of finger force.
    wrench : (d,) array
        Factors that make a wrench's moments forces, over ``length``.
    """

    origin: FloatArray
    length: float
    task: float
    force: float
    wrench: FloatArray

    @classmethod
    def of(cls, problem: GraspProblem) -> Scaling:
        """Return the scaling of a problem."""
        space, d = problem.body.space, problem.dimension
        length = problem.body.size
        wrench = np.concatenate([np.ones(space), np.full(d - space, 1.0 / length)])
        moment = problem.task.second_moment() * np.outer(wrench, wrench)
        size = float(np.sqrt(np.linalg.norm(moment, 2)))
        return cls(problem.origin, length, size, problem.budget.force_scale(), wrench)

    @property
    def beta(self) -> float:
        """The solver's beta is mu times this."""
        return self.task / self.force

    def position(self, p: FloatArray) -> FloatArray:
        """Return positions (..., space) in metres as solver units."""
        return np.asarray((p - self.origin) / self.length)

    def metres(self, p: FloatArray) -> FloatArray:
        """Return positions (..., space) in solver units as metres."""
        return np.asarray(self.origin + self.length * p)
