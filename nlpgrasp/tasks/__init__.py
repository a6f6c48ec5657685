"""Tasks: sets of wrenches that the fingers have to exert."""

from nlpgrasp.tasks.base import Task, TaskSum, task_from_dict
from nlpgrasp.tasks.convex import TaskSet
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.polytope import TaskPolytope
from nlpgrasp.tasks.registry import register

__all__ = ["Task", "TaskEllipsoid", "TaskPolytope", "TaskSet", "TaskSum", "register", "task_from_dict"]
