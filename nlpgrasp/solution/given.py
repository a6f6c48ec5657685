"""Type check of arguments that have to be solutions."""

from __future__ import annotations

from nlpgrasp.errors import InputError
from nlpgrasp.solution.frames.in_frame import SolutionInFrame
from nlpgrasp.solution.solution import GraspSolution


def given_solution(value: object) -> GraspSolution:
    """Return the argument if it is a solution, else raise ``InputError`` that says how to get one."""
    if isinstance(value, GraspSolution):
        return value
    if isinstance(value, SolutionInFrame):
        raise InputError("solution", repr(value), "the GraspSolution that in_frame was asked of, in the body's frame")
    made = "a GraspSolution, which ng.solve returns and ng.GraspSolution.load reads"
    raise InputError("solution", value if isinstance(value, str) else f"a {type(value).__name__}", made)
