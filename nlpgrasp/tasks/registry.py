"""The kinds of task that a file may hold."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.tasks.base import TASKS, Task, TaskSum
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.polytope import TaskPolytope

Kind = TypeVar("Kind", bound=Task)


def register(task: type[Kind]) -> type[Kind]:
    """Add a kind of task, of this package or another, to those that files may hold; also as a decorator.

    Parameters
    ----------
    task : subclass of Task
        With ``kind``, the name that its ``to_dict`` gives as ``type``, and ``from_dict``.

    Raises
    ------
    InputError
        When another task has that name.
    """
    TASKS.add(task.kind, task)
    return task


register(TaskEllipsoid)
register(TaskPolytope)
register(TaskSum)
