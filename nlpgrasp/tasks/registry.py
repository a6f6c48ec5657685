"""Registry of task types for JSON files."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.tasks.base import TASKS, Task, TaskSum
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.task_polytope import TaskPolytope
from nlpgrasp.tasks.task_set import TaskSet

Kind = TypeVar("Kind", bound=Task)


def register(task: type[Kind]) -> type[Kind]:
    """Register a task type for JSON files; also as a decorator.

    Parameters
    ----------
    task : subclass of Task
        With ``from_dict`` and ``kind``, which is the ``type`` in its ``to_dict``.

    Raises
    ------
    InputError
        When another task type has that name.
    """
    TASKS.add(task.kind, task)
    return task


register(TaskEllipsoid)
register(TaskPolytope)
register(TaskSet)
register(TaskSum)
