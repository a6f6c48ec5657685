"""Tasks: sets of wrenches that the fingers have to exert."""

from nlpgrasp.tasks.base import Task, TaskSum, task_from_dict, task_to_dict
from nlpgrasp.tasks.registry import register
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.task_polytope import TaskPolytope
from nlpgrasp.tasks.task_set import TaskSet

__all__ = ["Task", "TaskEllipsoid", "TaskPolytope", "TaskSet", "TaskSum", "register", "task_from_dict", "task_to_dict"]
