"""Well-spread samples of a task's boundary: wrenches and directions."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.unit_directions import directions, directions_inradius
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope

MOST_WRENCHES = 80  # most wrenches of a polytope that are all used


class TaskSamples:
    """Well-spread samples of a task's boundary, with a fixed number per draw.

    Parameters
    ----------
    task : Task
    unit : (d,) array
        Factors that turn a wrench into solver units.
    shells : {0, 1, 2}
        Number of direction shells; see ``directions``.
    """

    def __init__(self, task: Task, unit: FloatArray, shells: int) -> None:
        self.task, self.unit = task, unit
        self._all_wrenches: FloatArray | None = None  # the wrenches of a small polytope
        if isinstance(task, TaskPolytope) and len(task.wrenches) <= MOST_WRENCHES:
            self._all_wrenches = task.wrenches
        if isinstance(task, TaskEllipsoid):
            self._axes = task.axes * unit
        else:
            values, vectors = np.linalg.eigh(task.second_moment() * np.outer(unit, unit))
            self._axes = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        size = np.linalg.norm(self._axes, axis=1)
        self._spanned = size > 1e-9 * size.max()
        self._local, self._shells = directions(int(self._spanned.sum()), shells), shells

    @property
    def count(self) -> int:
        """Number of samples per draw."""
        return len(self._local) if self._all_wrenches is None else len(self._all_wrenches)

    @property
    def factors(self) -> tuple[float, ...]:
        """Factors on the samples' distance from the task's centre, in the order in which they are tried.

        A grasp that produces the samples produces their hull. If the task is not centred, the rest of the task may need
        forces of other directions, which scaling does not provide. Samples whose hull contains the task are therefore
        tried first, and those on its boundary if the former are infeasible.
        """
        if self._all_wrenches is not None or self.task.is_centred:
            return (1.0,)
        return (1.0 / directions_inradius(self._local.shape[1], self._shells), 1.0)

    def wrenches(self, rng: np.random.Generator | None = None, factor: float = 1.0) -> FloatArray:
        """Return boundary wrenches (m, d), randomly rotated in the task's axes; all wrenches of a small polytope.

        Parameters
        ----------
        rng : numpy.random.Generator, optional
            No rotation without one.
        factor : float
            On their distance from the task's centre.
        """
        if self._all_wrenches is not None:
            return self._all_wrenches
        local = self._rotated_directions(rng)
        if isinstance(self.task, TaskEllipsoid):
            return self.task.boundary(factor * local)
        wrenches = self._farthest(local)
        centre = wrenches.mean(axis=0)
        return np.asarray(centre + factor * (wrenches - centre))

    def directions(self, rng: np.random.Generator | None = None) -> FloatArray:
        """Return well-spread directions of wrench space, (m, d), as many as there are sampled wrenches."""
        y = self._directions_of(self._rotated_directions(rng))
        return y[np.arange(self.count) % len(y)]

    def containing(self) -> FloatArray:
        """Return well-spread directions y of all of wrench space, (m, d), whose hull contains the origin.

        Along axes in which the task has no extent it counts as a third of its largest. Those towards the wrenches of a
        small polytope are among them.
        """
        _, sizes, V = np.linalg.svd(self._axes)
        sizes = np.pad(sizes, (0, len(V) - len(sizes)))
        sizes = np.where(sizes > 1e-9 * sizes[0], sizes, sizes[0] / 3.0)
        u = directions(len(V), self._shells)
        if self._all_wrenches is not None:
            towards = (self._all_wrenches * self.unit) @ V.T / sizes
            lengths = np.linalg.norm(towards, axis=1)
            u = np.concatenate([u, towards[lengths > 0.0] / lengths[lengths > 0.0, None]])
        return np.asarray((u / sizes) @ V * self.unit)

    def _farthest(self, local: FloatArray) -> FloatArray:
        return self.task.support(self._directions_of(local))[1]

    def _rotated_directions(self, rng: np.random.Generator | None) -> FloatArray:
        """Return randomly rotated unit directions in the task's axes, (m, axes)."""
        n = int(self._spanned.sum())
        rotation = np.eye(n) if rng is None else np.linalg.qr(rng.standard_normal((n, n)))[0]
        result = np.zeros((len(self._local), len(self._axes)))
        result[:, self._spanned] = self._local @ rotation
        return result

    def _directions_of(self, local: FloatArray) -> FloatArray:
        """Return for each direction u in the task's axes L the y of least norm with ``L^T y = u``, solver units."""
        return np.asarray(np.linalg.lstsq(self._axes, local.T, rcond=None)[0].T * self.unit)
