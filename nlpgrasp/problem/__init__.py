"""Grasp problems as immutable data, independent of solvers."""

from nlpgrasp.problem.problem import GraspProblem

__all__ = [
    "GraspProblem",
]
