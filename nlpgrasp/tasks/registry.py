"""Tasks from JSON data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.polytope import TaskPolytope
from nlpgrasp.tasks.sum import TaskSum


def task_from_dict(data: Mapping[str, Any]) -> Task:
    """Return the task that ``to_dict`` wrote.

    Raises
    ------
    InputError
        When the type is unknown, or the numbers make no task.
    """
    kind = data.get("type") if isinstance(data, Mapping) else None
    try:
        if kind == "polytope":
            return TaskPolytope.from_dict(data)
        if kind == "sum":
            return TaskSum([task_from_dict(part) for part in data["tasks"]])
        if kind == "ellipsoid":
            return TaskEllipsoid.from_dict(data)
    except (KeyError, TypeError) as error:
        raise InputError(f"task of type {kind}", f"{type(error).__name__}: {error}", "what schema 1 says") from None
    raise InputError("task.type", kind, "ellipsoid, polytope or sum")
