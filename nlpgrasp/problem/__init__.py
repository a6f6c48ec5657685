"""What is asked: plain, frozen data that knows no solver."""

from nlpgrasp.problem.problem import GraspProblem

__all__ = [
    "GraspProblem",
]
