"""Argument validation of quality measures, and their extension to stacks of grasps."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Concatenate, ParamSpec, Protocol, overload

import numpy as np

from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.tasks import Task

P = ParamSpec("P")
NO_ORIGIN = (
    "task.torque_origin: neither task nor grasp states one, so moments are about the frame's origin, away from the "
    "contacts: a problem's are about the body's centroid; solution.task and task.given_about(point) state theirs"
)


class StackableMeasure(Protocol[P]):
    """Protocol of a quality measure: a number for a grasp, an array for a stack of grasps."""

    @overload
    def __call__(self, grasp: Grasp, *args: P.args, **kwargs: P.kwargs) -> float: ...
    @overload
    def __call__(self, grasp: GraspStack, *args: P.args, **kwargs: P.kwargs) -> FloatArray: ...


def extend_to_stacks(measure: Callable[Concatenate[Grasp, P], float]) -> StackableMeasure[P]:
    """Return a measure of one grasp extended to stacks, evaluated grasp by grasp."""

    @overload
    def measure_each(grasp: Grasp, *args: P.args, **kwargs: P.kwargs) -> float: ...
    @overload
    def measure_each(grasp: GraspStack, *args: P.args, **kwargs: P.kwargs) -> FloatArray: ...
    def measure_each(grasp: Grasp | GraspStack, *args: P.args, **kwargs: P.kwargs) -> float | FloatArray:
        if isinstance(grasp, GraspStack):
            return np.array([measure(member, *args, **kwargs) for member in grasp])
        return measure(grasp, *args, **kwargs)

    update_wrapper(measure_each, measure)
    return measure_each


def require_grasp(value: object, *, stack: bool = False) -> None:
    """Raise an ``InputError`` for anything but a grasp (or, with ``stack``, a stack of grasps)."""
    if not isinstance(value, (Grasp, GraspStack) if stack else Grasp):
        raise InputError("grasp", value, "a Grasp or a GraspStack" if stack else "a Grasp")


def task_for(value: object, grasp: Grasp | GraspStack) -> Task:
    """Return the task about the grasp's torque origin; raise an ``InputError`` unless it fits the grasp.

    Warns
    -----
    UserWarning
        Once, where neither of them states a torque origin and the frame's origin is more than twice as far from the
        middle of the contacts as they are.
    """
    dimension = grasp.dimension
    if not isinstance(value, Task):
        raise InputError("task", value, "a task such as ng.TaskEllipsoid")
    if value.dimension != dimension:
        raise InputError("task", f"dimension {value.dimension}", f"the grasp's wrench dimension {dimension}")
    if value.torque_origin is None and not grasp.states_origin:
        middle = grasp.points.mean(axis=-2, keepdims=True)
        if len(grasp.contacts) * np.sum(middle**2) > 4.0 * np.sum((grasp.points - middle) ** 2) > 0.0:
            warn_once(NO_ORIGIN)
    return value.about(grasp.torque_origin)
