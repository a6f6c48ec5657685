"""Base class of tasks, Minkowski sums of tasks, and changes of frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.registry import Registry
from nlpgrasp.common.spatial import Pose, move_torque_origin, rigid_transform, rotate_body_frame, space_dimension
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number, prefix_errors, read_only
from nlpgrasp.errors import InputError


class Task(ABC):
    """A convex set of wrenches the fingers have to exert, given by its support function (Section 3.3).

    The wrenches are those that the fingers exert on the body: against an external load w, ``-w``. A task type that can
    be stored has a ``kind``, its name in files, and ``from_dict``, and is registered in ``tasks.registry``.

    Attributes
    ----------
    torque_origin : (space,) array or None
        Reference point of moments, body frame, metres. The task of a problem or solution has that of the problem, and
        measures convert it to a grasp's own; ``None`` stands for the torque origin of the problem or grasp that the
        task is used with.
    point_left_out : bool
        Whether a force acts at the body frame's origin only by default.
    origin_left_out : bool
        Whether the torque origin is that of a problem only because the task stated none.
    """

    kind: ClassVar[str]
    torque_origin: FloatArray | None = None
    point_left_out: bool = False
    origin_left_out: bool = False
    __array_ufunc__ = None  # numpy arrays must not broadcast over a task

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""

    @property
    @abstractmethod
    def is_centred(self) -> bool:
        """Whether the set is symmetric about the origin: then mu (3.3-4a) applies, else mu-tilde (3.3-4b)."""

    @property
    def measure(self) -> str:
        """Quality measure for this task: ``"mu"`` if it is centred, else ``"mu_tilde"``."""
        return "mu" if self.is_centred else "mu_tilde"

    @property
    def paper_beta(self) -> float | None:
        """Scale beta of a centred ellipsoid (3.3-3); ``None`` for other tasks.

        mu is a multiple of beta.
        """
        return None

    @abstractmethod
    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function and a maximiser for each direction.

        Parameters
        ----------
        y : (m, d) array
            Directions of wrench space.

        Returns
        -------
        values, maximisers : (m,) and (m, d) arrays
            ``phi(y | A)``, the largest ``<y, w>`` over wrenches w of the task, and maximisers (the gradient).
        """

    @abstractmethod
    def transformed(self, matrix: FloatArray) -> Task:
        """Return the linear image of the task under ``matrix`` (d', d)."""

    @abstractmethod
    def second_moment(self) -> FloatArray:
        """Return a second-moment matrix of the set, (d, d), for whitening only.

        No bound depends on this matrix.
        """

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the task as JSON data, without its torque origin, which ``task_to_dict`` adds.

        The entry ``type`` is the task's ``kind``.
        """

    @classmethod
    def from_dict(cls, data: Json) -> Task:
        """Return the task from the data of its ``to_dict``."""
        raise InputError("task.type", data.get("type"), f"a kind that can be read, which {cls.__name__} cannot")

    def support_rows(self) -> tuple[bool, FloatArray] | None:
        """Return the rows that state the support function in full; None for a task given by a function.

        Returns
        -------
        is_polytope : bool
            Whether the rows are the wrenches of a polytope.
        rows : (m, d) array
            Those wrenches; otherwise the centre and the semi-axes of an ellipsoid.
        """
        return None

    def ends(self) -> FloatArray:
        """Return representative wrenches of the task's boundary, (m, d), newtons and newton-metres."""
        values, vectors = np.linalg.eigh(self.second_moment())
        directions = vectors[:, values > 1e-12 * values[-1]].T
        wrenches = self.support(np.concatenate([directions, -directions]))[1]
        return np.asarray(wrenches[np.linalg.norm(wrenches, axis=1) > 0.0])

    def at(self, origin: ArrayLike) -> Task:
        """Return the task with moments about another point, (3.3-7).

        Parameters
        ----------
        origin : (space,) array
            Metres, body frame. A task without a torque origin is taken to be about the body frame's origin.
        """
        space = space_dimension(self.dimension)
        new = array("origin", origin, (space,))
        old = np.zeros(space) if self.torque_origin is None else self.torque_origin
        result = copy(self) if np.array_equal(new, old) else self.transformed(move_torque_origin(new - old))
        return result._set_origin(new)

    def about(self, origin: ArrayLike) -> Task:
        """Return the task as a grasp or problem with this torque origin uses it.

        Converted to it as by ``at``; without a torque origin of its own, the task is about it already, as by
        ``given_about``.

        Parameters
        ----------
        origin : (space,) array
            Metres, body frame.
        """
        return self.given_about(origin) if self.torque_origin is None else self.at(origin)

    def in_frame(self, pose: Pose) -> Task:
        """Return the task in another body frame, (2.5-5).

        Its torque origin is transformed too.

        Parameters
        ----------
        pose : (3, 3) array in the plane, (4, 4) in space, or mapping
            A point x of this frame is ``A x + b`` in the other; formats as for ``Grasp.in_frame``.
        """
        matrix, origin = change_of_frame(pose, self.dimension, self.torque_origin)
        return self.transformed(matrix)._set_origin(origin)

    def given_about(self, origin: ArrayLike) -> Self:
        """Return a copy with unchanged wrenches and the given reference point of moments."""
        space = space_dimension(self.dimension)
        return copy(self)._set_origin(array("origin", origin, (space,)))

    def without_origin(self) -> Self:
        """Return a copy with unchanged wrenches, about the torque origin of whatever it is used with."""
        return copy(self)._set_origin(None)

    def _set_origin(self, origin: FloatArray | None) -> Self:
        self.torque_origin, self.origin_left_out = None if origin is None else read_only(np.array(origin)), False
        return self

    def __add__(self, other: object) -> Task:
        """Return the Minkowski sum of two tasks."""
        if not isinstance(other, Task):
            return NotImplemented
        check_alike(self, other)
        addend = other if self.torque_origin is None else other.at(self.torque_origin)
        single = self._plus(addend) or addend._plus(self)
        if single is None:
            return TaskSum([*parts_of(self), *parts_of(addend)])
        single.point_left_out = self.point_left_out or other.point_left_out
        return single._set_origin(self.torque_origin)

    def _plus(self, other: Task) -> Task | None:
        """Return the Minkowski sum with another task as one task, or ``None`` if only a ``TaskSum`` can state it.

        Both tasks are about the same point.
        """
        del other
        return None

    def _moved(self, wrench: FloatArray) -> Task | None:
        """Return the set translated by a wrench (d,), or ``None`` if no task of the same type can state it."""
        del wrench
        return None

    def __mul__(self, factor: float) -> Task:
        """Return the task scaled by a positive number."""
        scale = number("factor", factor, above=0.0)
        return self.transformed(scale * np.eye(self.dimension))._set_origin(self.torque_origin)

    __rmul__ = __mul__


class TaskSum(Task):
    """Minkowski sum of tasks, ``{w_1 + ... + w_m : w_i in A_i}``, such as gravity plus a tool's wrench.

    Parameters
    ----------
    tasks : sequence of Task
        At least one; all of one dimension, about one point.
    """

    kind: ClassVar[str] = "sum"

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.tasks = tuple(tasks) if isinstance(tasks, Sequence) else ()
        if not self.tasks or not all(isinstance(task, Task) for task in self.tasks):
            raise InputError("TaskSum.tasks", tasks, "at least one task")
        first = self.tasks[0]
        for other in self.tasks[1:]:
            check_alike(first, other)
        origin = first.torque_origin
        if origin is not None:
            self.tasks = (first, *(task.at(origin) for task in self.tasks[1:]))
        self._set_origin(origin)

    def _set_origin(self, origin: FloatArray | None) -> Self:
        self.tasks = tuple(copy(task)._set_origin(origin) for task in self.tasks)
        return super()._set_origin(origin)

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return self.tasks[0].dimension

    @property
    def is_centred(self) -> bool:
        """Whether all summands are symmetric about the origin."""
        return all(task.is_centred for task in self.tasks)

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along ``y`` (m, d), and the maximisers (m, d).

        Both are sums over the summands.
        """
        parts = [task.support(y) for task in self.tasks]
        return np.sum([p[0] for p in parts], axis=0), np.sum([p[1] for p in parts], axis=0)

    def transformed(self, matrix: FloatArray) -> TaskSum:
        """Return the sum of the summands' linear images under ``matrix`` (d', d)."""
        return TaskSum([task.transformed(matrix) for task in self.tasks])

    def second_moment(self) -> FloatArray:
        """Return the sum of the summands' second moments, (d, d)."""
        return np.asarray(np.sum([task.second_moment() for task in self.tasks], axis=0))

    def to_dict(self) -> Json:
        """Return the summands as JSON data."""
        return {"type": self.kind, "tasks": [task.to_dict() for task in self.tasks]}

    @classmethod
    def from_dict(cls, data: Json) -> TaskSum:
        """Return the sum from the data of its ``to_dict``."""
        return cls([task_from_dict(part) for part in data["tasks"]])

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.tasks))


TASKS: Registry[Task] = Registry("task.type")


def task_to_dict(task: Task) -> Json:
    """Return a task as JSON data, with its torque origin if it has one."""
    origin = task.torque_origin
    return task.to_dict() if origin is None else {**task.to_dict(), "torque_origin": origin.tolist()}


def task_from_dict(data: Json) -> Task:
    """Return a task of any registered type from the data of ``task_to_dict``.

    Raises
    ------
    InputError
        When the type is unknown or the data are invalid.
    """
    name = data.get("type") if isinstance(data, Mapping) else None
    kind = TASKS.find(name)
    if kind is None:
        raise TASKS.unknown(name)
    try:
        task = kind.from_dict(data)
        with prefix_errors("task.torque_"):
            return task.given_about(data["torque_origin"]) if "torque_origin" in data else task
    except (KeyError, TypeError) as error:
        raise InputError(f"task of type {name}", f"{type(error).__name__}: {error}", "what schema 1 says") from None


def parts_of(task: Task) -> tuple[Task, ...]:
    """Return the summands of a task; the task itself if it is no sum."""
    return task.tasks if isinstance(task, TaskSum) else (task,)


def component_ranges(task: Task) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest values of a task's wrench components, (d,) each, N and N m."""
    axes = np.eye(task.dimension)
    return -task.support(-axes)[0], task.support(axes)[0]


class Framed(Protocol):
    """Protocol of objects with a wrench dimension and a reference point of moments."""

    torque_origin: FloatArray | None

    @property
    def dimension(self) -> int:
        """Dimension of wrench space: 3 or 6."""


def check_alike(first: Framed, second: Framed) -> None:
    """Raise if two tasks differ in dimension, or if only one has a known reference point."""
    if first.dimension != second.dimension:
        raise InputError("task", f"dimensions {first.dimension} and {second.dimension}", "tasks of one dimension")
    if (first.torque_origin is None) != (second.torque_origin is None):
        raise InputError(
            "task",
            "a sum of wrenches about a known point and about the problem's torque origin",
            "task.given_about(origin) for the second",
        )


def change_of_frame(pose: Pose, dimension: int, origin: FloatArray | None) -> tuple[FloatArray, FloatArray | None]:
    """Return the wrench map (d, d) of a change of body frame (2.5-6), and the reference point in the new frame.

    Raises
    ------
    InputError
        When the pose is not a rigid transform of this space.
    """
    A, b = rigid_transform("pose", pose, space_dimension(dimension))
    return rotate_body_frame(A), None if origin is None else A @ origin + b
