"""What was found: plain, frozen data, and its file."""

from nlpgrasp.solution.findings import Conflict, Robustness, ShadowPrice, WhyNot
from nlpgrasp.solution.solution import UNKNOWN, ConstraintReport, GraspSolution, StartRecord, Status, SurfaceMatch

__all__ = [
    "UNKNOWN",
    "Conflict",
    "ConstraintReport",
    "GraspSolution",
    "Robustness",
    "ShadowPrice",
    "StartRecord",
    "Status",
    "SurfaceMatch",
    "WhyNot",
]
