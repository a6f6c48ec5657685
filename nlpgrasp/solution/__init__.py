"""Solutions of grasp problems: immutable data with certificates, and their JSON files."""

from nlpgrasp.solution.analysis_records import Conflict, Robustness, ShadowPrice, WhyNot
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.placed_grasp import SurfaceMatch
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
