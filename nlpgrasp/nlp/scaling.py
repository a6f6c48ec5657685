"""Scaling of the nonlinear program: units of length, force and beta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem


@dataclass(frozen=True)
class Scaling:
    """Typical sizes of a problem's variables, by which the solver's variables are scaled.

    Parameters
    ----------
    origin : (space,) array
        Torque origin, metres, the zero of the solver's positions.
    length : float
        The body's characteristic length, metres.
    task : float
        Size of the task's wrenches, newtons, with moments divided by ``length``.
    force : float
        Newtons per solver unit of finger force.
    wrench : (d,) array
        Factors that divide a wrench's moments by ``length``.
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
        """Factor from mu to the solver's beta."""
        return self.task / self.force

    def position(self, p: FloatArray) -> FloatArray:
        """Convert positions (..., space) from metres to solver units."""
        return np.asarray((p - self.origin) / self.length)

    def metres(self, p: FloatArray) -> FloatArray:
        """Convert positions (..., space) from solver units to metres."""
        return np.asarray(self.origin + self.length * p)
