"""Wrenches at which a task touches the boundary of a wrench set, with the direction and the forces there.

Under other budgets than L2 the support function has kinks, and most minimisers of the support ratio are at such: the
wrench set W has facets. At a minimiser y with the ratio r and the task's maximiser a, the wrench ``r a`` is in the face
of W with the normal y (0 is in the generalised gradient of ``phi_W - r phi_A``), so that forces x in B ∩ K exert it. Of
all forces that maximise <y, G x>, these give the derivative of the largest scale of a: ``<y, dG x>`` over ``<y, a>``
(Danskin 1966, doi:10.1137/0114053, for the linear program whose dual variables are y).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.containment import Containment
from nlpgrasp.quality.force_problem import LeastForces


@dataclass(frozen=True)
class TightWrenches:
    """Minimisers of the support ratio, with the forces that exert the task's wrenches there.

    Parameters
    ----------
    directions : (m, r) array
        Coordinates of the containment.
    ratios : (m,) array
    forces : (m, n) array
        In B ∩ K, contact frames.
    """

    directions: FloatArray
    ratios: FloatArray
    forces: FloatArray

    def __len__(self) -> int:
        return len(self.ratios)


def tight_wrenches(
    problem: Containment, u: FloatArray, rounds: int = 30, settled: float = 1e-8, remembered: int = 5
) -> TightWrenches:
    """Return the minimisers of the support ratio that an alternating descent finds from directions u (m, r).

    The least forces for the task's maximiser a at a direction y have a dual direction F(y), whose ratio is at most that
    of the first one: ``phi_W(F) / phi_A(F) <= phi_W(F) / <F, a> <= phi_W(y) / <y, a>``. It comes next; where that takes
    long, as where W and A are both smooth, Anderson's method takes a longer step to the fixed point (Walker and Ni
    2011, doi:10.1137/10078356X).

    Parameters
    ----------
    problem : Containment
    u : (m, r) array
    rounds : int
    settled : float
        Change of a unit direction at which it is a minimiser.
    remembered : int
        Steps that Anderson's method combines.
    """
    forces_for = LeastForces(problem.wrenches)
    iterations = [_FixedPoint(y / np.linalg.norm(y), remembered) for y in u]
    active = list(iterations)
    for _ in range(rounds):
        wrenches = problem.task.support(np.array([iteration.y for iteration in active]))[1]
        x, y = forces_for.solve(wrenches)
        lengths = np.linalg.norm(y, axis=1, keepdims=True)
        y = y / np.where(lengths > 0.0, lengths, np.nan)
        ratios = problem.ratio(np.where(np.isfinite(y), y, 1.0))[0]
        active = [
            iteration
            for iteration, *found in zip(active, y, x, ratios, strict=True)
            if np.all(np.isfinite(found[0])) and iteration.advance(*found) > settled
        ]
        if not active:
            break
    known = [iteration for iteration in iterations if len(iteration.forces)]
    if not known:
        return TightWrenches(u[:0], np.zeros(0), np.zeros((0, problem.wrenches.G.shape[1])))
    forces = np.array([iteration.forces for iteration in known])
    amounts = problem.wrenches.force_set.gauge(forces)
    return TightWrenches(
        np.array([iteration.best for iteration in known]),
        np.array([iteration.ratio for iteration in known]),
        forces / amounts[:, None],
    )


class _FixedPoint:
    """Fixed-point iteration of one direction by Anderson's method, as long as ratios fall."""

    def __init__(self, y: FloatArray, remembered: int) -> None:
        self.y, self.best, self.forces, self.ratio = y, y, np.zeros(0), np.inf
        self._remembered, self._steps, self._images = remembered, list[FloatArray](), list[FloatArray]()

    def advance(self, image: FloatArray, forces: FloatArray, ratio: float) -> float:
        """Take the image of the present direction, its forces and ratio; return how far the direction was from it."""
        step = image - self.y
        if ratio > (1.0 + 1e-9) * self.ratio:  # too long a step: go on from the best image
            self.y, self._steps, self._images = self.best, [], []
            return float(np.linalg.norm(step))
        self.y, self.best, self.forces, self.ratio = image, image, forces, ratio
        self._steps = [*self._steps, step][-self._remembered :]
        self._images = [*self._images, image][-self._remembered :]
        if len(self._steps) > 1:
            weights = np.linalg.lstsq(np.diff(self._steps, axis=0).T, step, rcond=1e-10)[0]
            y = image - np.diff(self._images, axis=0).T @ weights
            if np.linalg.norm(y - image) < 1.0:
                self.y = y / np.linalg.norm(y)
        return float(np.linalg.norm(step))
