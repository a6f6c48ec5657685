"""Reference points of moments, and changes of body frame."""

from __future__ import annotations

from typing import Protocol

from nlpgrasp.common.given.pose import Pose, rigid_transform
from nlpgrasp.common.spatial import rotate_body_frame, space_dimension
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError


class Framed(Protocol):
    """Protocol of objects with a wrench dimension and a reference point of moments."""

    about: FloatArray | None

    @property
    def dimension(self) -> int:
        """Dimension of wrench space: 3 or 6."""


def check_alike(one: Framed, other: Framed) -> None:
    """Raise if two tasks differ in dimension, or if only one has a known reference point."""
    if one.dimension != other.dimension:
        raise InputError("task", f"dimensions {one.dimension} and {other.dimension}", "tasks of one dimension")
    if (one.about is None) != (other.about is None):
        raise InputError(
            "task",
            "a sum of wrenches about a known point and about the problem's torque origin",
            "task.given_about(origin) for the second",
        )


def change_of_frame(pose: Pose, dimension: int, about: FloatArray | None) -> tuple[FloatArray, FloatArray | None]:
    """Return the wrench map ``blockdiag(A, A)`` (d, d) of a change of body frame (2.5-6), and the mapped point.

    Raises
    ------
    InputError
        When the pose is not a rigid transform of this space.
    """
    A, b = rigid_transform("pose", pose, space_dimension(dimension))
    return rotate_body_frame(A), None if about is None else A @ about + b
