"""Convex task given by a support function."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task

Support = Callable[[FloatArray], tuple[FloatArray, FloatArray] | FloatArray]
DIFFERENCE = 1e-6  # relative step of the central differences
PROBES = 200  # random directions that check the support function


class TaskSet(Task):
    """A convex set of wrenches given by its support function (Definition 3-8).

    Parameters
    ----------
    support : callable
        Maps directions (m, d) to ``phi(y | A)`` (m,), or to that and the maximisers (m, d). Must be convex and
        positively homogeneous; maximisers that are not given are computed by central differences.
    dimension : {3, 6}
        Of the wrenches: 3 in the plane, 6 in space.

    Raises
    ------
    InputError
        When the function returns other shapes or values that are not finite, or is not convex and positively
        homogeneous.
    """

    def __init__(self, support: Support, dimension: int = 6) -> None:
        if type(dimension) is not int or dimension not in (3, 6):
            raise InputError("TaskSet.dimension", dimension, "3 (planar) or 6")
        self._set(support, dimension)

    def _set(self, support: Support, dimension: int) -> None:
        if not callable(support):
            raise InputError("TaskSet.support", support, "a function of directions (m, d)")
        self._support, self._dimension = support, dimension
        probes = np.random.default_rng(0).standard_normal((PROBES, self._dimension))
        probes /= np.linalg.norm(probes, axis=1, keepdims=True)
        values, maximisers = self.support(probes)
        doubled = self.support(2.0 * probes)[0]
        error = float(np.max(np.abs(doubled - 2.0 * values)))
        if error > 1e-6 * max(float(np.max(np.abs(values))), 1e-300):
            raise InputError(
                "TaskSet.support", f"phi(2 y) off 2 phi(y) by {error:.3g}", "a positively homogeneous function"
            )
        if not np.any(maximisers):
            raise InputError("TaskSet.support", "a function that is zero everywhere", "a set of more than the origin")
        half = PROBES // 2
        sums = self.support(probes[:half] + probes[half:])[0] - values[:half] - values[half:]
        if float(np.max(sums)) > 1e-6 * float(np.max(np.abs(values))):
            raise InputError(
                "TaskSet.support", f"phi(y + z) above phi(y) + phi(z) by {np.max(sums):.3g}", "a convex function"
            )
        self._moment = maximisers.T @ maximisers * (self._dimension / PROBES)
        opposite = self.support(-probes)[0]
        if float(np.min(values + opposite)) < -1e-6 * float(np.max(np.abs(values))):
            raise InputError("TaskSet.support", "phi(y) + phi(-y) below 0", "the support function of a set")
        self._centred = bool(np.max(np.abs(values - opposite)) <= 1e-9 * np.max(np.abs(values)))

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return self._dimension

    def __repr__(self) -> str:
        return f"TaskSet(support=..., dimension={self._dimension})"

    @property
    def is_centred(self) -> bool:
        """Whether the support function is even in all probed directions."""
        return self._centred

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the function's values and maximisers along ``y`` (m, d), (m,) and (m, d)."""
        try:
            result = self._support(y)
        except InputError:
            raise
        except Exception as error:
            raise InputError(
                "TaskSet.support", f"{type(error).__name__}: {error}", "a function of directions (m, d)"
            ) from error
        if isinstance(result, tuple) and len(result) == 2:
            values, maximisers = _check_numbers(result[0]), _check_numbers(result[1])
        else:
            values = _check_numbers(result)
            if values.shape != (len(y),):
                raise InputError("TaskSet.support", f"shape {values.shape}", f"({len(y)},), a value a direction")
            size = DIFFERENCE * np.maximum(np.linalg.norm(y, axis=1), 1e-300)
            columns = []
            for e in np.eye(self._dimension):
                forward, backward = (np.asarray(self._support(y + s * size[:, None] * e)) for s in (1.0, -1.0))
                columns.append((forward - backward) / (2.0 * size))
            maximisers = np.stack(columns, axis=1)
        if values.shape != (len(y),) or maximisers.shape != y.shape:
            raise InputError(
                "TaskSet.support", f"shapes {values.shape} and {maximisers.shape}", f"({len(y)},) and {y.shape}"
            )
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(maximisers))):
            raise InputError("TaskSet.support", "a value that is not finite", "a bounded set of wrenches")
        return values, maximisers

    def transformed(self, matrix: FloatArray) -> TaskSet:
        """Return the linear image: ``phi(y | M A) = phi(M^T y | A)``."""

        def support(y: FloatArray) -> tuple[FloatArray, FloatArray]:
            values, maximisers = self.support(y @ matrix)
            return values, maximisers @ matrix.T

        result = TaskSet.__new__(TaskSet)
        result._set(support, len(matrix))
        return result

    def second_moment(self) -> FloatArray:
        """Return the second moment (d, d) of maximisers in random directions."""
        return self._moment

    def to_dict(self) -> Json:
        """Raise: a function has no JSON form."""
        raise InputError("task", "a TaskSet", "a task with a JSON form, such as a TaskEllipsoid")


def _check_numbers(value: ArrayLike) -> FloatArray:
    """Return a result of the support function as an array of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("TaskSet.support", value, "arrays of numbers") from None
