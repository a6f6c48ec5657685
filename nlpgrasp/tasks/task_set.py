"""Convex tasks given by their support functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar
from weakref import WeakSet

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.common.value_digest import function_digest, is_comparable, value_digest
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task, parts_of

Support = Callable[[FloatArray], tuple[FloatArray, FloatArray] | FloatArray]
FIELD = "TaskSet.support"
DIFFERENCE = 1e-6  # relative step of the central differences
KINK, ASIDE = 1e-3, 1e-4  # relative second difference of a kink; relative distance of a smooth direction near it
PROBES = 200  # random directions that check the support function
STORED = 24  # random directions of a file, each with its opposite, beside the coordinate axes
TOLERANCE = 1e-6  # relative to the largest value: homogeneity, convexity, maximisers
SAME = 1e-9  # relative to the largest value: two functions are one, or a function is even
MISSING = (
    "the task is a function, and the file has some of its values alone: make the same TaskSet in this process, "
    "by nlpgrasp verify --script SCRIPT or as the problem's script does (functions are compared by code and captured "
    "values; one that reads files, random numbers or the clock has no equal)"
)


class SupportFunction:
    """Validated support function of a convex set, with samples that files store.

    Parameters
    ----------
    function : callable
        As for ``TaskSet``.
    dimension : {3, 6}

    Attributes
    ----------
    directions, wrenches : (m, d) array
        Directions of the samples and their maximisers.
    values : (m,) array
        Support of the samples.
    moment : (d, d) array
        Second moment of maximisers in random directions.
    is_centred : bool
        Whether the function is even in all probed directions.
    is_sampled : bool
        Whether it is the hull of a file's samples of a function that this process does not have.
    """

    is_sampled = False

    def __init__(self, function: Support, dimension: int) -> None:
        if type(dimension) is not int or dimension not in (3, 6):
            raise InputError("TaskSet.dimension", dimension, "3 (planar) or 6")
        if not callable(function):
            raise InputError(FIELD, function, "a function of directions (m, d)")
        self._function, self.dimension = function, dimension
        self._digests = set[str]()  # stated so far: more than one where the function's state changes
        self._unpickled = False
        probes = np.random.default_rng(0).standard_normal((PROBES, dimension))
        probes /= np.linalg.norm(probes, axis=1, keepdims=True)
        values, maximisers = self(probes)
        self._check(probes, values, maximisers)
        self.moment = maximisers.T @ maximisers * (dimension / PROBES)
        directions = np.concatenate([np.eye(dimension), probes[:STORED]])
        directions = np.concatenate([directions, -directions])
        self._set_samples(directions, *self(directions))

    def _check(self, probes: FloatArray, values: FloatArray, maximisers: FloatArray) -> None:
        """Raise if the function is not positively homogeneous and convex, or if its set is the origin alone."""
        tolerance = TOLERANCE * max(float(np.max(np.abs(values))), 1e-300)
        error = float(np.max(np.abs(self(2.0 * probes)[0] - 2.0 * values)))
        if error > tolerance:
            raise InputError(FIELD, f"phi(2 y) off 2 phi(y) by {error:.3g}", "a positively homogeneous function")
        if not np.any(maximisers):
            raise InputError(FIELD, "a function that is zero everywhere", "a set of more than the origin")
        half = PROBES // 2
        excess = float(np.max(self(probes[:half] + probes[half:])[0] - values[:half] - values[half:]))
        if excess > tolerance:
            raise InputError(FIELD, f"phi(y + z) above phi(y) + phi(z) by {excess:.3g}", "a convex function")
        excess = float(np.max(probes @ maximisers.T - values[:, None]))
        if excess > tolerance:
            expected = "a convex function, with maximisers in its set"
            raise InputError(FIELD, f"a maximiser w with <y, w> above phi(y) by {excess:.3g}", expected)
        if float(np.min(values + self(-probes)[0])) < -tolerance:
            raise InputError(FIELD, "phi(y) + phi(-y) below 0", "the support function of a set")

    def _set_samples(self, directions: FloatArray, values: FloatArray, wrenches: FloatArray) -> None:
        """Set the samples along directions (2 m, d), whose second half is opposite to the first."""
        self.directions, self.values, self.wrenches = directions, values, wrenches
        first, second = np.split(values, 2)
        self.is_centred = bool(np.max(np.abs(first - second)) <= SAME * np.max(np.abs(values)))
        _functions.add(self)

    def __call__(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values and maximisers along ``y`` (m, d), (m,) and (m, d)."""
        result = self._evaluate(y)
        if isinstance(result, tuple) and len(result) == 2:
            values, maximisers = _check_numbers(result[0]), _check_numbers(result[1])
        else:
            values = _check_numbers(result)
            if values.shape != (len(y),):
                raise InputError(FIELD, f"shape {values.shape}", f"({len(y)},), a value a direction")
            maximisers = self._differences(y, values)
        if values.shape != (len(y),) or maximisers.shape != y.shape:
            raise InputError(FIELD, f"shapes {values.shape} and {maximisers.shape}", f"({len(y)},) and {y.shape}")
        return values, maximisers

    def _evaluate(self, y: FloatArray) -> tuple[FloatArray, FloatArray] | FloatArray:
        """Return the result of the user's function; raise its errors as ``InputError``."""
        try:
            return self._function(y)
        except InputError:
            raise
        except Exception as error:
            raise InputError(FIELD, f"{type(error).__name__}: {error}", "a function of directions (m, d)") from error

    def _differences(self, y: FloatArray, values: FloatArray, aside: float = ASIDE) -> FloatArray:
        """Return maximisers (m, d) by central differences.

        Where the function has a kink, several wrenches attain it and differences may be none of them: they are then
        taken in a direction beside it.
        """
        size = np.maximum(np.linalg.norm(y, axis=1), 1e-300)
        step, columns, bends = DIFFERENCE * size, [], []
        for e in np.eye(self.dimension):
            forward, backward = (_check_numbers(self._evaluate(y + s * step[:, None] * e)) for s in (1.0, -1.0))
            columns.append((forward - backward) / (2.0 * step))
            bends.append(np.abs(forward + backward - 2.0 * values) / step)
        maximisers = np.stack(columns, axis=1)
        is_kink = np.max(bends, axis=0) > KINK * np.max(np.abs(maximisers), initial=1e-300)
        if aside > 0.0 and np.any(is_kink):
            offset = np.random.default_rng(1).standard_normal(self.dimension)
            nearby = y[is_kink] + aside * size[is_kink, None] * offset
            maximisers[is_kink] = self._differences(nearby, _check_numbers(self._evaluate(nearby)), 0.0)
        return maximisers

    @property
    def digest(self) -> str:
        """Digest of the user's function; of a copy in another process that of the original."""
        if self._unpickled or self.is_sampled or not all(map(is_comparable, self._digests)):
            return next(iter(self._digests))
        digest = function_digest(self._function)
        self._digests.add(digest)
        return digest

    def has_digest(self, digest: str) -> bool:
        """Return whether the function has a digest, or had it when it was saved."""
        return digest in self._digests or digest == self.digest

    def check_comparable(self) -> None:
        """Raise ``IncomparableError`` if the function cannot be compared with that of another process."""
        value_digest(self._function)

    def __getstate__(self) -> dict[str, object]:
        """Return the state with the digest, which a copy of a function may not have."""
        return {**self.__dict__, "_digests": {self.digest}, "_unpickled": True}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Restore a pickled function, which files of this process then refer to."""
        self.__dict__.update(state)
        _functions.add(self)

    def to_dict(self) -> Json:
        """Return the function's digest, and the samples, as JSON data."""
        samples = {name: getattr(self, name).tolist() for name in ("directions", "values", "wrenches")}
        return {"function": self.digest, **samples}

    @classmethod
    def from_dict(cls, data: Json) -> SupportFunction:
        """Return the function created in this process that has the digest and samples, or the support of their hull.

        Warns
        -----
        UserWarning
            Once, without one.
        """
        directions = array("task.directions", data["directions"], (None, None))
        values = array("task.values", data["values"], (len(directions),))
        wrenches = array("task.wrenches", data["wrenches"], directions.shape)
        half = len(directions) // 2
        if len(directions) != 2 * half or not half or not np.array_equal(directions[:half], -directions[half:]):
            raise InputError("task.directions", f"{len(directions)} rows", "directions, then their opposites")
        digest = str(data.get("function", ""))
        function = _find_function(directions, values, digest)
        if function is not None:
            return function
        warn_once(f"problem.task: the hull of {len(wrenches)} wrenches is taken for the task; {MISSING}")
        hull = cls(lambda y: _hull_support(wrenches, y), directions.shape[1])
        hull._set_samples(directions, values, wrenches)
        hull.is_sampled, hull._digests = True, {digest}
        return hull


def _find_function(directions: FloatArray, values: FloatArray, digest: str) -> SupportFunction | None:
    """Return the function created in this process with a digest and values along directions (m, d), or ``None``."""
    tolerance = SAME * max(float(np.max(np.abs(values))), 1e-300)
    for function in _functions:
        if function.is_sampled or function.dimension != directions.shape[1] or not function.has_digest(digest):
            continue
        if np.max(np.abs(function(directions)[0] - values)) <= tolerance:
            return function
    return None


_functions: WeakSet[SupportFunction] = WeakSet()  # those created in this process, where a file finds its function


class TaskSet(Task):
    """A convex set of wrenches given by its support function (Definition 3-8).

    A file has the function's digest and its values in some directions. Where it is read in a process that has made the
    same ``TaskSet``, that is the task; elsewhere the hull of the values' wrenches stands for it, and a warning says so.
    Two functions are the same if their code, captured values, defaults, and the globals that they name are.

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
        When the function returns other shapes or values that are not finite (an unbounded set), or is not convex and
        positively homogeneous along the probed directions.
    """

    kind: ClassVar[str] = "set"

    def __init__(self, support: Support, dimension: int = 6) -> None:
        self._set(SupportFunction(support, dimension), None)

    def _set(self, function: SupportFunction, matrix: FloatArray | None) -> TaskSet:
        self._function, self._matrix = function, np.eye(function.dimension) if matrix is None else matrix
        return self

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return len(self._matrix)

    @property
    def is_centred(self) -> bool:
        """Whether the support function is even in all probed directions."""
        return self._function.is_centred

    @property
    def is_sampled(self) -> bool:
        """Whether the task is the hull of stored wrenches, in place of a support function unknown to this process."""
        return self._function.is_sampled

    def check_comparable(self) -> None:
        """Raise ``IncomparableError`` if the function cannot be compared with that of another process."""
        self._function.check_comparable()

    def __repr__(self) -> str:
        support = f"hull of {len(self._function.wrenches)} wrenches of a file" if self.is_sampled else "..."
        return f"TaskSet(support={support}, dimension={self.dimension})"

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along ``y`` (m, d), and the maximisers (m, d)."""
        values, maximisers = self._function(y @ self._matrix)
        return values, maximisers @ self._matrix.T

    def transformed(self, matrix: FloatArray) -> TaskSet:
        """Return the linear image: ``phi(y | M A) = phi(M^T y | A)``."""
        return TaskSet.__new__(TaskSet)._set(self._function, matrix @ self._matrix)

    def second_moment(self) -> FloatArray:
        """Return the second moment (d, d) of maximisers in random directions."""
        return np.asarray(self._matrix @ self._function.moment @ self._matrix.T)

    def to_dict(self) -> Json:
        """Return digest and samples of the support function, and the linear map of its set, as JSON data."""
        return {"type": self.kind, "matrix": self._matrix.tolist(), **self._function.to_dict()}

    @classmethod
    def from_dict(cls, data: Json) -> TaskSet:
        """Return the task from the data of its ``to_dict``."""
        function = SupportFunction.from_dict(data)
        matrix = array("task.matrix", data["matrix"], (function.dimension, function.dimension))
        return cls.__new__(cls)._set(function, matrix)


def is_sampled(task: Task) -> bool:
    """Return whether a task, or a part of it, was read from a file without its support function."""
    return any(isinstance(part, TaskSet) and part.is_sampled for part in parts_of(task))


def _hull_support(wrenches: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return support (n,) and maximisers (n, d) of the hull of wrenches (m, d) along ``y`` (n, d)."""
    work = y @ wrenches.T
    best = np.argmax(work, axis=1)
    return work[np.arange(len(y)), best], wrenches[best]


def _check_numbers(value: object) -> FloatArray:
    """Return a result of the support function as an array of finite numbers."""
    try:
        result = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(FIELD, value, "arrays of numbers") from None
    if not np.all(np.isfinite(result)):
        raise InputError(FIELD, "a value that is not finite", "a bounded set of wrenches")
    return result
