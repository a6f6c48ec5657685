"""Tasks: the set of wrenches a grasp has to resist."""

from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.convex import TaskSet
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid

__all__ = ["Task", "TaskEllipsoid", "TaskSet"]
