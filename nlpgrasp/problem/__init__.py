"""Grasp problem: immutable problem data, independent of solvers."""

from nlpgrasp.problem.problem import GraspProblem

__all__ = [
    "GraspProblem",
]
