"""A fixed placement of contacts, and many at once."""

from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack

__all__ = [
    "Grasp",
    "GraspStack",
]
