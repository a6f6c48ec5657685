"""Minkowski sums of tasks: support functions add."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, Self

import numpy as np

from nlpgrasp.common.validation import FloatArray, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.polytope import TaskPolytope

MOST_VERTICES = 400  # of the sum of two polytopes that is written as one


class TaskSum(Task):
    """``{w_1 + ... + w_m : w_i in A_i}``: gravity in any orientation and a tool's wrench at the same time.

    Parameters
    ----------
    tasks : sequence of Task
        At least one; all of one dimension, about one point.
    """

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.tasks = tuple(tasks) if isinstance(tasks, Sequence) else ()
        if not self.tasks or not all(isinstance(task, Task) for task in self.tasks):
            raise InputError("TaskSum.tasks", tasks, "at least one task")
        first = self.tasks[0]
        for other in self.tasks[1:]:
            first._check_same(other)
        if first.about is not None:
            self.tasks = (first, *(task.at(first.about) for task in self.tasks[1:]))
        self._about(first.about)

    def _about(self, origin: FloatArray | None) -> Self:
        self.tasks = tuple(copy(task)._about(origin) for task in self.tasks)
        return super()._about(origin)

    @property
    def dimension(self) -> int:
        """Dimension of wrench space."""
        return self.tasks[0].dimension

    @property
    def is_centred(self) -> bool:
        """Whether all parts are."""
        return all(task.is_centred for task in self.tasks)

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the sums of the parts' supports and of their maximisers."""
        parts = [task.support(y) for task in self.tasks]
        return np.sum([p[0] for p in parts], axis=0), np.sum([p[1] for p in parts], axis=0)

    def transformed(self, matrix: FloatArray) -> TaskSum:
        """Return the sum of the images."""
        return TaskSum([task.transformed(matrix) for task in self.tasks])

    def second_moment(self) -> FloatArray:
        """Return the sum of the parts' second moments."""
        return np.asarray(np.sum([task.second_moment() for task in self.tasks], axis=0))

    def to_dict(self) -> dict[str, Any]:
        """Return the parts."""
        return {"type": "sum", "tasks": [task.to_dict() for task in self.tasks]}

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.tasks))


def sum_of(one: Task, other: Task) -> Task:
    """Return the Minkowski sum, in its simplest form: polytopes stay polytopes, a point moves a task."""
    one._check_same(other)
    if one.about is not None:
        other = other.at(one.about)
    for a, b in ((one, other), (other, one)):
        if isinstance(a, TaskPolytope) and len(a.wrenches) == 1 and isinstance(b, TaskEllipsoid):
            return TaskEllipsoid.from_axes(b.axes, b.center + a.wrenches[0])._about(one.about)
    if isinstance(one, TaskPolytope) and isinstance(other, TaskPolytope):
        together = (one.wrenches[:, None] + other.wrenches[None]).reshape(-1, one.dimension)
        if len(together) <= MOST_VERTICES:
            return TaskPolytope(read_only(together))._about(one.about)
    parts = [part for task in (one, other) for part in (task.tasks if isinstance(task, TaskSum) else (task,))]
    return TaskSum(parts)
