"""Grasp solutions: frozen data with evidence, and their JSON files."""

from nlpgrasp.solution.findings import Conflict, Robustness, WhyNot
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.placed import SurfaceMatch
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solution.records import UNKNOWN, ConstraintReport, StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

__all__ = [
    "UNKNOWN",
    "Conflict",
    "ConstraintReport",
    "FoundGrasp",
    "GraspSolution",
    "Robustness",
    "ShadowPrice",
    "StartRecord",
    "Status",
    "SurfaceMatch",
    "WhyNot",
]
