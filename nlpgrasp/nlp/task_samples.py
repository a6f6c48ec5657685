"""The wrenches of a task that the first program of a start looks at."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.directions import directions, inradius
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope

MOST_WRENCHES = 80  # of a polytope that are all looked at


class TaskSamples:
    """Well-spread samples of a task's boundary, as many at every draw.

    Parameters
    ----------
    task : Task
    unit : (d,) array
        Factors that turn a wrench into solver units.
    shells : {0, 1, 2}
        How many; see ``directions``.
    """

    def __init__(self, task: Task, unit: FloatArray, shells: int) -> None:
        self.task, self.unit = task, unit
        self._all: FloatArray | None = None  # the wrenches of a small polytope
        if isinstance(task, TaskPolytope) and len(task.wrenches) <= MOST_WRENCHES:
            self._all = task.wrenches
        if isinstance(task, TaskEllipsoid):
            self._axes = task.axes * unit
        else:
            values, vectors = np.linalg.eigh(task.second_moment() * np.outer(unit, unit))
            self._axes = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        size = np.linalg.norm(self._axes, axis=1)
        self._used = size > 1e-9 * size.max()
        self._local, self._shells = directions(int(self._used.sum()), shells), shells

    @property
    def count(self) -> int:
        """Number of samples of a draw."""
        return len(self._local) if self._all is None else len(self._all)

    @property
    def factors(self) -> tuple[float, ...]:
        """How far beyond the task its samples may be moved, the first to be tried first.

        A grasp that produces the samples produces their hull. Where the task's middle is not zero the rest of the
        task may need forces of other directions, which no grasp that lacks them has at any size: samples so far
        out that the task is in their hull are tried first, and the task's own where that is too much to ask.
        """
        if self._all is not None or self.task.is_centred:
            return (1.0,)
        return (1.0 / inradius(self._local.shape[1], self._shells), 1.0)

    def wrenches(self, rng: np.random.Generator | None = None, factor: float = 1.0) -> FloatArray:
        """Return wrenches of the boundary, (m, d), turned at random in the task's own axes; all of a small polytope's.

        Parameters
        ----------
        rng : numpy.random.Generator, optional
            Not turned without one.
        factor : float
            Of their distance from the task's middle.
        """
        if self._all is not None:
            return self._all
        local = self._turned(rng)
        if isinstance(self.task, TaskEllipsoid):
            return self.task.boundary(factor * local)
        found = self._farthest(local)
        middle = found.mean(axis=0)
        return np.asarray(middle + factor * (found - middle))

    def directions(self, rng: np.random.Generator | None = None) -> FloatArray:
        """Return as many directions of wrench space, (m, d)."""
        y = self._y(self._turned(rng))
        return y[np.arange(self.count) % len(y)]

    def _farthest(self, local: FloatArray) -> FloatArray:
        return self.task.support(self._y(local))[1]

    def _turned(self, rng: np.random.Generator | None) -> FloatArray:
        """Return unit directions in the task's own axes, (m, axes)."""
        n = int(self._used.sum())
        turn = np.eye(n) if rng is None else np.linalg.qr(rng.standard_normal((n, n)))[0]
        result = np.zeros((len(self._local), len(self._axes)))
        result[:, self._used] = self._local @ turn
        return result

    def _y(self, local: FloatArray) -> FloatArray:
        """Return the y with ``L^T y`` along each local direction (least norm in solver units)."""
        return np.asarray(np.linalg.lstsq(self._axes, local.T, rcond=None)[0].T * self.unit)
