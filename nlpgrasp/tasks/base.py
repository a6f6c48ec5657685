"""What every task states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.spatial import move_torque_origin, space_dimension
from nlpgrasp.common.validation import FloatArray, array, number, read_only
from nlpgrasp.errors import InputError


class Task(ABC):
    """A convex set of wrenches the grasp has to resist, known by its support function (Section 3.3).

    The wrenches are those that the fingers exert on the body: against a load w of the surroundings, ``-w``.

    Attributes
    ----------
    about : (space,) array or None
        Point of the body frame about which moments are taken; ``None`` stands for the torque origin of whatever
        problem or grasp the task is used with.
    """

    about: FloatArray | None = None
    __array_ufunc__ = None  # an array times a task is no array of tasks

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension of wrench space: 3 or 6."""

    @property
    @abstractmethod
    def is_centred(self) -> bool:
        """Whether the set is symmetric about the origin: mu is then (3.3-4a), otherwise mu-tilde (3.3-4b)."""

    @abstractmethod
    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function and a maximiser for each direction.

        Parameters
        ----------
        y : (m, d) array

        Returns
        -------
        values : (m,) array
            ``phi(y | A)``.
        maximisers : (m, d) array
            Wrenches of the task that attain them; also the gradient where it exists.
        """

    @abstractmethod
    def transformed(self, matrix: FloatArray) -> Task:
        """Return the linear image of the task under ``matrix`` (d', d)."""

    @abstractmethod
    def second_moment(self) -> FloatArray:
        """Return a (d, d) matrix with the set's shape: used to whiten wrench space, never in a bound."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the task as JSON data; ``about`` is not part of it."""

    def ends(self) -> FloatArray:
        """Return some wrenches of the task's boundary that say what it asks for, (m, d)."""
        values, vectors = np.linalg.eigh(self.second_moment())
        along = vectors[:, values > 1e-12 * values[-1]].T
        found = self.support(np.concatenate([along, -along]))[1]
        return np.asarray(found[np.linalg.norm(found, axis=1) > 0.0])

    def at(self, origin: ArrayLike) -> Task:
        """Return the same wrenches with moments about another point, (3.3-7).

        Parameters
        ----------
        origin : (space,) array
            Metres, body frame. A task whose ``about`` is ``None`` is taken to be about the body frame's origin.
        """
        space = space_dimension(self.dimension)
        new = array("origin", origin, (space,))
        old = np.zeros(space) if self.about is None else self.about
        result = copy(self) if np.array_equal(new, old) else self.transformed(move_torque_origin(new - old))
        return result._about(new)

    def given_about(self, origin: ArrayLike) -> Self:
        """Return the task as one whose moments were about this point all along."""
        space = space_dimension(self.dimension)
        return copy(self)._about(array("origin", origin, (space,)))

    def _about(self, origin: FloatArray | None) -> Self:
        self.about = None if origin is None else read_only(np.array(origin))
        return self

    def __add__(self, other: object) -> Task:
        """Return the Minkowski sum: any wrench of this task together with any of the other."""
        from nlpgrasp.tasks.sum import sum_of  # a sum is a task itself

        if not isinstance(other, Task):
            return NotImplemented
        return sum_of(self, other)

    def __mul__(self, factor: float) -> Task:
        """Return the task scaled by a positive number."""
        scale = number("factor", factor, above=0.0)
        return self.transformed(scale * np.eye(self.dimension))._about(self.about)

    __rmul__ = __mul__

    def _check_same(self, other: Task) -> None:
        """Refuse a task of another dimension, or with moments about another point or an unknown one."""
        if self.dimension != other.dimension:
            raise InputError("task", f"dimensions {self.dimension} and {other.dimension}", "tasks of one dimension")
        if (self.about is None) != (other.about is None):
            raise InputError(
                "task",
                "a sum of wrenches about a known point and about the problem's torque origin",
                "task.given_about(origin) for the second",
            )
