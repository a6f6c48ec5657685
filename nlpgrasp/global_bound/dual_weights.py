"""Optimal dual weights of directions: a batch of small linear programs, by an interior-point method.

For supports ``A[i, v, j]`` of contact i at row v along direction j, the least bound over weights lambda,
``min over lambda of sum_i max_v sum_j lambda_j A[i, v, j]``, is a linear program; its dual spreads each contact over
its rows (a fractional placement). All nodes of a batch are solved together by a primal-dual path-following method from
the strictly feasible point of equal weights (Wright, "Primal-dual interior-point methods", 1997,
doi:10.1137/1.9781611971453).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray

ITERATIONS = 14  # largest number of Newton steps
CENTRING = 0.05  # centring parameter of the path-following method
ENOUGH = 1e-6  # mean complementarity, relative to the largest support, at which iterations end
INSIDE = 0.95  # fraction of the step to the boundary
REGULAR = 1e-9  # relative increase of the Newton matrix's diagonal
LIGHT = 1e-3  # computed weight below which a direction is dropped
DIGITS = 8  # digits of recorded weights
LEAST = 1e-5  # recorded weight below which a direction is dropped


class DualWeights(NamedTuple):
    """Set of dual weights of directions, with a threshold."""

    indices: IntArray  # (j,), of the directions
    weights: FloatArray  # (j,), at least zero
    threshold: float = 0.0  # theta, zero but under the shared budget

    def rounded(self) -> DualWeights:
        """Return the weights as recorded: rounded, without negligible ones."""
        weights = round_weights(self.weights)
        return DualWeights(self.indices[weights > 0.0], weights[weights > 0.0], self.threshold)


def round_weights(weights: FloatArray) -> FloatArray:
    """Return weights (j,) rounded to the recorded digits, with negligible ones set to zero."""
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
        Dual weights, at least zero, of sum one, optimal within a tolerance; any such weights give a valid bound.
    fractions : (b, k, m) array
        Fraction of each contact at each row, of sum one.
    """
    scale = np.max(A, axis=(1, 2, 3))
    A = A / np.where(scale > 0.0, scale, 1.0)[:, None, None, None]
    state = _InteriorPoint(A)
    for _ in range(ITERATIONS):
        gap = state.gap()
        if np.max(gap) < ENOUGH:
            break
        state.step(CENTRING * np.maximum(gap, 0.01 * ENOUGH))
    weights = np.where(state.directions > LIGHT, state.directions, 0.0)
    is_valid = np.any(weights > 0.0, axis=1) & np.all(np.isfinite(state.fractions), axis=(1, 2))
    weights = np.where(is_valid[:, None], weights, 1.0)  # equal weights where the method failed
    fractions = np.where(is_valid[:, None, None], state.fractions, 1.0 / A.shape[2])
    return weights / np.sum(weights, axis=1, keepdims=True), fractions


class _InteriorPoint:
    """Interior-point iterate of a batch of linear programs: dual weights, fractional placements and slacks.

    ``row_slack = t_i - A_i lambda`` complements the fractions w; ``direction_slack = A^T w - theta`` the weights.
    """

    def __init__(self, A: FloatArray) -> None:
        b, k, m, j = A.shape
        self.shape = (b, k, m)
        self.A = A.reshape(b, k * m, j)
        self.AT = np.ascontiguousarray(self.A.transpose(0, 2, 1))
        self.directions = np.full((b, j), 1.0 / j)
        self.fractions = np.full((b, k, m), 1.0 / m)
        totals = self._weight_directions(self.directions)
        self.row_slack = np.max(totals, axis=2, keepdims=True) + 0.1 - totals
        totals_by_direction = self._weight_rows(self.fractions)
        self.direction_slack = totals_by_direction - np.min(totals_by_direction, axis=1, keepdims=True) + 0.1

    def _weight_directions(self, x: FloatArray) -> FloatArray:
        """Return the sums (b, k, m) over directions of supports weighted by dual weights x: ``A x``."""
        return np.asarray((self.A @ x[:, :, None]).reshape(self.shape))

    def _weight_rows(self, w: FloatArray) -> FloatArray:
        """Return the sums (b, j) over contacts and their cells of supports weighted by fractions w: ``A^T w``."""
        return np.asarray((self.AT @ w.reshape(len(w), -1, 1))[:, :, 0])

    def gap(self) -> FloatArray:
        """Return the mean complementarity of each program, (b,)."""
        total = np.sum(self.row_slack * self.fractions, axis=(1, 2)) + np.sum(
            self.direction_slack * self.directions, axis=1
        )
        return np.asarray(total / (self.A.shape[1] + self.A.shape[2]))

    def step(self, target: FloatArray) -> None:
        """Take one Newton step towards complementarity products ``target`` (b,)."""
        b, k, m = self.shape
        j = self.A.shape[2]
        ratio, direction_ratio = self.fractions / self.row_slack, self.direction_slack / self.directions
        row_residual = target[:, None, None] / self.row_slack - self.fractions
        direction_residual = target[:, None] / self.directions - self.direction_slack
        weighted = self.A * ratio.reshape(b, k * m, 1)
        by_contact, total = weighted.reshape(b, k, m, j).sum(axis=2), ratio.sum(axis=2)
        M = self.AT @ weighted - (by_contact / total[:, :, None]).transpose(0, 2, 1) @ by_contact
        diagonal = np.arange(j)
        M[:, diagonal, diagonal] += direction_ratio + REGULAR * (1.0 + M[:, diagonal, diagonal])
        contact_residual = row_residual.sum(axis=2)
        eliminated = (by_contact.transpose(0, 2, 1) @ (contact_residual / total)[:, :, None])[:, :, 0]
        right_side = direction_residual - self._weight_rows(row_residual) + eliminated
        solutions = np.linalg.solve(M, np.stack([right_side, np.ones_like(right_side)], axis=2))
        theta = -np.sum(solutions[:, :, 0], axis=1) / np.sum(solutions[:, :, 1], axis=1)
        direction_step = solutions[:, :, 0] + solutions[:, :, 1] * theta[:, None]
        height = (contact_residual + (by_contact @ direction_step[:, :, None])[:, :, 0]) / total
        row_slack_step = height[:, :, None] - self._weight_directions(direction_step)
        fraction_step = row_residual - ratio * row_slack_step
        slack_step = direction_residual - direction_ratio * direction_step
        primal_length = np.minimum(
            _step_length(self.row_slack, row_slack_step), _step_length(self.directions, direction_step)
        )
        dual_length = np.minimum(
            _step_length(self.fractions, fraction_step), _step_length(self.direction_slack, slack_step)
        )
        self.row_slack = self.row_slack + primal_length[:, None, None] * row_slack_step
        self.directions = self.directions + primal_length[:, None] * direction_step
        self.fractions = self.fractions + dual_length[:, None, None] * fraction_step
        self.direction_slack = self.direction_slack + dual_length[:, None] * slack_step


def _step_length(x: FloatArray, step: FloatArray) -> FloatArray:
    """Return the largest step length up to 1 that keeps x positive, (b,)."""
    rate = np.max((-step / x).reshape(len(x), -1), axis=1)
    return np.asarray(np.minimum(1.0, INSIDE / np.maximum(rate, 1e-9)))
