"""Task containment: the largest multiple of a task inside a wrench set, in well-conditioned coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.wrench_set import WrenchSet, central_differences, numerical_rank
from nlpgrasp.tasks import Task

FLAT_CONDITION = 1e-10  # relative eigenvalue of the task's shape below which it is regularised
ROUNDING = 1e-9  # relative guard against rounding


@dataclass(frozen=True)
class Containment:
    """Task containment ``alpha A inside W``, in wrench coordinates ``w' = M w``.

    The largest alpha is ``min phi_W(y) / phi_A(y)`` over directions with ``phi_A(y) > 0`` (Theorem 3-9). It does not
    depend on the coordinates, which are chosen for conditioning: the task becomes round, and coordinates along which
    the contacts exert no wrench are dropped.

    Parameters
    ----------
    wrenches : WrenchSet
        In the new coordinates, full row rank.
    task : Task
        In the new coordinates.
    given : tuple of WrenchSet and Task
        Both in the old coordinates.
    matrix : (r, d) array
        M; a direction u of the new coordinates is ``M^T u`` in the old ones.
    rounding : float
        Relative guard for the arithmetic of the change of coordinates.
    """

    wrenches: WrenchSet
    task: Task
    given: tuple[WrenchSet, Task]
    matrix: FloatArray
    rounding: float = ROUNDING

    @property
    def rank(self) -> int:
        """Number r of the coordinates."""
        return int(self.matrix.shape[0])

    def ratio(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ratio ``phi_W / phi_A`` and its gradient at directions (m, r), (m,) and (m, r).

        The ratio is inf where ``phi_A <= 0``.
        """
        phi, wrench = self.wrenches.support(u)
        reach, demand = self.task.support(u)
        positive = reach > 1e-12 * np.linalg.norm(u, axis=1)
        divisor = np.where(positive, reach, 1.0)
        value = np.where(positive, phi / divisor, np.inf)
        gradient = (wrench - np.where(positive, value, 0.0)[:, None] * demand) / divisor[:, None]
        return value, gradient

    def hessian(self, u: FloatArray) -> FloatArray:
        """Return the Hessian (m, r, r) of the support ratio at unit directions (m, r).

        With the ratio's gradient g and the task's maximiser a it is ``(D2 phi_W - ratio D2 phi_A - g a^T - a g^T) /
        phi_A``.
        """
        value, gradient = self.ratio(u)
        reach, demand = self.task.support(u)
        is_bounded = np.isfinite(value)
        cross = gradient[:, :, None] * demand[:, None, :]
        curvature = self.wrenches.hessian(u) - cross - cross.transpose(0, 2, 1)
        curvature -= np.where(is_bounded, value, 0.0)[:, None, None] * central_differences(self.task.support, u)
        return curvature / np.where(is_bounded, reach, np.inf)[:, None, None]

    def to_wrench_direction(self, u: FloatArray) -> FloatArray:
        """Map a direction (r,) to a unit direction (d,) in the original wrench coordinates."""
        y = u @ self.matrix
        return y / np.linalg.norm(y)


def make_containment(wrenches: WrenchSet, task: Task) -> tuple[Containment | None, FloatArray | None]:
    """Return the task containment in well-conditioned coordinates, or a proof by rank that mu is 0.

    Returns
    -------
    containment : Containment or None
    proof : (d,) array or None
        A direction along which no contact can exert a wrench although the task requires one.
    """
    moment = task.second_moment()
    scale = np.sqrt(np.diag(moment) + np.sum(wrenches.G**2, axis=1))
    scale = np.where(scale > 0.0, scale, 1.0)
    vectors, values, _ = np.linalg.svd(wrenches.G / scale[:, None])
    rank = numerical_rank(values)
    null = (vectors[:, rank:] / scale[:, None]).T  # directions without any wrench
    for y in null:
        pair = np.stack([y, -y])
        reach = task.support(pair)[0]
        if reach.max() > 1e-9 * np.linalg.norm(np.sqrt(np.diag(moment)) * y):
            return None, pair[int(np.argmax(reach))] / np.linalg.norm(y)
    if rank == 0:
        return None, None
    reduction = (vectors[:, :rank] / scale[:, None]).T  # (rank, d)
    shape = reduction @ moment @ reduction.T
    spread = np.linalg.eigvalsh(shape)
    if spread[0] <= FLAT_CONDITION * spread[-1]:
        gram = reduction @ wrenches.G @ wrenches.G.T @ reduction.T
        shape = shape + 0.1 * np.trace(shape) / np.trace(gram) * gram
        least = 1e-14 * float(np.trace(shape))  # wrenches may be as flat as the task, from far away
        shape = shape + max(0.0, least - float(np.linalg.eigvalsh(shape)[0])) * np.eye(rank)
    matrix = np.linalg.solve(np.linalg.cholesky(shape), reduction)
    rounding = ROUNDING + 1e-14 * float(np.linalg.cond(shape)) ** 0.5
    return Containment(wrenches.transformed(matrix), task.transformed(matrix), (wrenches, task), matrix, rounding), None
