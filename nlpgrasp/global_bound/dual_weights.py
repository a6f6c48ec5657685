"""Optimal dual weights of directions: a batch of small linear programs, by an interior-point method.

For supports ``A[i, v, j]`` of contact i at row v along direction j, the least bound over mixtures,
``min over lambda of sum_i max_v sum_j lambda_j A[i, v, j]``, is a linear program; its dual spreads each contact over
its rows. All nodes of a batch are solved together by a primal-dual path-following method from the strictly feasible
point of equal weights (Wright, "Primal-dual interior-point methods", 1997, doi:10.1137/1.9781611971453).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import IntArray

ITERATIONS = 14  # Newton steps, at most
CENTRING = 0.05  # centring parameter of the path-following method
ENOUGH = 1e-6  # mean complementarity, relative to the largest support, at which iterations end
INSIDE = 0.95  # share of the step to the boundary
REGULAR = 1e-9  # relative increase of the Newton matrix's diagonal
LIGHT = 1e-3  # solved weight below which a direction is dropped
DIGITS = 8  # digits of recorded weights
LEAST = 1e-5  # recorded weight below which a direction is dropped


class DualWeights(NamedTuple):
    """Dual weights, (j,), at least zero, of directions by number, (j,)."""

    numbers: IntArray
    weights: FloatArray

    def written(self) -> DualWeights:
        """Return the weights as recorded: few digits, without negligible ones."""
        weights = round_weights(self.weights)
        return DualWeights(self.numbers[weights > 0.0], weights[weights > 0.0])


def round_weights(weights: FloatArray) -> FloatArray:
    """Return weights (j,) rounded to the recorded digits."""
    result = np.where(weights < LEAST, 0.0, np.round(weights, DIGITS))
    return np.asarray(np.round(result / np.sum(result), DIGITS)) if np.count_nonzero(result) == 1 else result


def optimal_dual_weights(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return optimal dual weights of directions, with the fractional placements dual to them.

    Parameters
    ----------
    A : (b, k, m, j) array
        At least zero.

    Returns
    -------
    directions : (b, j) array
        At least zero, of sum one. To a tolerance only: any such weights give a bound that holds.
    designs : (b, k, m) array
        How much of each contact is at each row, of sum one over the rows.
    """
    scale = np.max(A, axis=(1, 2, 3))
    A = A / np.where(scale > 0.0, scale, 1.0)[:, None, None, None]
    program = _InteriorPoint(A)
    for _ in range(ITERATIONS):
        gap = program.gap()
        if np.max(gap) < ENOUGH:
            break
        program.step(CENTRING * np.maximum(gap, 0.01 * ENOUGH))
    weights = np.where(program.directions > LIGHT, program.directions, 0.0)
    good = np.any(weights > 0.0, axis=1) & np.all(np.isfinite(program.designs), axis=(1, 2))
    weights = np.where(good[:, None], weights, 1.0)  # equal ones where the method failed
    designs = np.where(good[:, None, None], program.designs, 1.0 / A.shape[2])
    return weights / np.sum(weights, axis=1, keepdims=True), designs


class _InteriorPoint:
    """Interior-point state of a batch of linear programs: weights, fractional placements, and slacks of both.

    ``slack = t_i - A_i lambda`` belongs to the designs, ``worth = A^T w - theta`` to the directions.
    """

    def __init__(self, A: FloatArray) -> None:
        b, k, m, j = A.shape
        self.shape = (b, k, m)
        self.A = A.reshape(b, k * m, j)
        self.AT = np.ascontiguousarray(self.A.transpose(0, 2, 1))
        self.directions = np.full((b, j), 1.0 / j)
        self.designs = np.full((b, k, m), 1.0 / m)
        reached = self._over(self.directions)
        self.slack = np.max(reached, axis=2, keepdims=True) + 0.1 - reached
        value = self._under(self.designs)
        self.worth = value - np.min(value, axis=1, keepdims=True) + 0.1

    def _over(self, x: FloatArray) -> FloatArray:
        """Return ``A x`` by contact and row."""
        return np.asarray((self.A @ x[:, :, None]).reshape(self.shape))

    def _under(self, w: FloatArray) -> FloatArray:
        """Return ``A^T w``."""
        return np.asarray((self.AT @ w.reshape(len(w), -1, 1))[:, :, 0])

    def gap(self) -> FloatArray:
        """Return the mean complementarity, (b,)."""
        total = np.sum(self.slack * self.designs, axis=(1, 2)) + np.sum(self.worth * self.directions, axis=1)
        return np.asarray(total / (self.A.shape[1] + self.A.shape[2]))

    def step(self, target: FloatArray) -> None:
        """Take one Newton step towards complementarity products ``target`` (b,)."""
        b, k, m = self.shape
        j = self.A.shape[2]
        ratio, other = self.designs / self.slack, self.worth / self.directions
        push = target[:, None, None] / self.slack - self.designs
        pull = target[:, None] / self.directions - self.worth
        weighted = self.A * ratio.reshape(b, k * m, 1)
        by_contact, total = weighted.reshape(b, k, m, j).sum(axis=2), ratio.sum(axis=2)
        M = self.AT @ weighted - (by_contact / total[:, :, None]).transpose(0, 2, 1) @ by_contact
        diagonal = np.arange(j)
        M[:, diagonal, diagonal] += other + REGULAR * (1.0 + M[:, diagonal, diagonal])
        pushed = push.sum(axis=2)
        right = pull - self._under(push) + (by_contact.transpose(0, 2, 1) @ (pushed / total)[:, :, None])[:, :, 0]
        x = np.linalg.solve(M, np.stack([right, np.ones_like(right)], axis=2))
        theta = -np.sum(x[:, :, 0], axis=1) / np.sum(x[:, :, 1], axis=1)
        along = x[:, :, 0] + x[:, :, 1] * theta[:, None]
        height = (pushed + (by_contact @ along[:, :, None])[:, :, 0]) / total
        slack = height[:, :, None] - self._over(along)
        designs, worth = push - ratio * slack, pull - other * along
        first = np.minimum(_largest_positive_step(self.slack, slack), _largest_positive_step(self.directions, along))
        second = np.minimum(_largest_positive_step(self.designs, designs), _largest_positive_step(self.worth, worth))
        self.slack = self.slack + first[:, None, None] * slack
        self.directions = self.directions + first[:, None] * along
        self.designs = self.designs + second[:, None, None] * designs
        self.worth = self.worth + second[:, None] * worth


def _largest_positive_step(x: FloatArray, step: FloatArray) -> FloatArray:
    """Return the largest step at most 1 that keeps x positive, (b,)."""
    back = np.max((-step / x).reshape(len(x), -1), axis=1)
    return np.asarray(np.minimum(1.0, INSIDE / np.maximum(back, 1e-9)))
