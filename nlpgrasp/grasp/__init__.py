"""Grasps: contacts at fixed points with their grasp map, single or stacked."""

from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack

__all__ = [
    "Grasp",
    "GraspStack",
]
