"""What the public functions of this layer accept."""

from __future__ import annotations

from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.tasks import Task


def require_grasp(value: object, *, stack: bool = False) -> None:
    """Refuse what is not a grasp (or, where allowed, a stack of them)."""
    if not isinstance(value, (Grasp, GraspStack) if stack else Grasp):
        raise InputError("grasp", value, "a Grasp or a GraspStack" if stack else "a Grasp")


def task_for(value: object, grasp: Grasp | GraspStack) -> Task:
    """Return a task about the grasp's torque origin; refuse what is none, or is of another dimension."""
    dimension = grasp.dimension
    if not isinstance(value, Task):
        raise InputError("task", value, "a task such as ng.TaskEllipsoid")
    if value.dimension != dimension:
        raise InputError("task", f"dimension {value.dimension}", f"the grasp's wrench dimension {dimension}")
    return value if value.about is None else value.at(grasp.torque_origin)
