"""Weakest directions of fractional placements (contacts spread over their cells), by descent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.global_bound.bound.measure import Measure
from nlpgrasp.global_bound.bound.supports import Supports
from nlpgrasp.global_bound.cells.base import IntArray
from nlpgrasp.quality.inverse_iteration import descend
from nlpgrasp.tasks import Task

STEPS = 5
REGULAR = 1e-6
LEAST = 1e-2  # weight of a contact in the quadratic model, relative to the largest


@dataclass(frozen=True)
class Design:
    """Fractional placement of identical contacts over rows, for a batch of nodes.

    Parameters
    ----------
    contact : ContactModel
    measure : Measure
    maps : (b, m, d, n_i) array
        Grasp maps of the contact at each place.
    weights : (b, m) array
        At least zero.
    """

    contact: ContactModel
    measure: Measure
    maps: FloatArray
    weights: FloatArray

    @classmethod
    def over(cls, supports: Supports, rows: IntArray, weights: FloatArray, most: int) -> Design:
        """Return the fractional placements of a batch over rows (b, m), of the heaviest alone where there are many."""
        if rows.shape[1] > most:
            heavy = np.argpartition(-weights, most, axis=1)[:, :most]
            total = np.sum(weights, axis=1, keepdims=True)
            rows = np.take_along_axis(rows, heavy, axis=1)
            weights = np.take_along_axis(weights, heavy, axis=1)
            weights = weights * (total / np.sum(weights, axis=1, keepdims=True))
        return cls(supports.contact, supports.measure, supports.maps[rows], weights)

    def value(self, twists: FloatArray) -> FloatArray:
        """Return ``sum of w s^p`` along twists (b, m, d), (b, m)."""
        s = self.supports(twists)
        return np.asarray(np.sum(s**self.measure.power * self.weights[:, None], axis=2))

    def supports(self, twists: FloatArray) -> FloatArray:
        """Return the support of each contact along twists (b, m, d), (b, m, r)."""
        return self._work(twists)[1]

    def model(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the value, (b, m), and the Hessian of a quadratic model of it, (b, m, d, d)."""
        p, maps = self.measure.power, self.maps
        z, s = self._work(twists)
        shares = np.broadcast_to(self.weights[:, None], s.shape)
        if p != 2.0:  # sum of w s^(p-2) |P z|^2 / 2, as in ``quality.screening``
            relative = np.maximum(s / np.maximum(np.max(s, axis=2, keepdims=True), 1e-300), LEAST)
            shares = shares * relative ** (p - 2.0)
        bent = self.contact.derivative(z) * shares[..., None, None]
        b, m, r, n = z.shape
        d = maps.shape[2]
        left = (maps[:, None] @ bent).transpose(0, 1, 3, 2, 4).reshape(b, m, d, r * n)
        right = maps.transpose(0, 1, 3, 2).reshape(b, 1, r * n, d)
        return np.sum(s**p * self.weights[:, None], axis=2), left @ right

    def _work(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return force components (b, m, r, n) and supports (b, m, r)."""
        b, r, d, n = self.maps.shape
        z = (twists @ self.maps.transpose(0, 2, 1, 3).reshape(b, d, r * n)).reshape(b, twists.shape[1], r, n)
        return z, self.measure.support(self.contact, z)


def normalised(task: Task, twists: FloatArray) -> FloatArray:
    """Return twists (..., d) scaled so that the task does unit work along them; zero where it does none."""
    reach = task.support(twists.reshape(-1, twists.shape[-1]))[0].reshape(twists.shape[:-1])
    size = np.linalg.norm(twists, axis=-1)
    does = (reach > 1e-12 * size) & np.isfinite(size)
    return np.where(does[..., None], twists / np.where(does, reach, 1.0)[..., None], 0.0)


def descended(
    designs: Sequence[Design], task: Task, twists: FloatArray, steps: int = STEPS
) -> tuple[FloatArray, FloatArray]:
    """Minimise ``phi_G / phi_A`` of fractional placements from twists (b, m, d), by inverse iteration.

    Returns
    -------
    twists : (b, m, d) array
        Along which the task does unit work.
    ratios : (b, m) array
        ``phi_G / phi_A`` there.
    """
    power = designs[0].measure.power

    def model(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        parts = [design.model(u) for design in designs]
        value, H = (np.sum([part[i] for part in parts], axis=0) for i in (0, 1))
        diagonal = np.arange(u.shape[2])
        scale = np.max(H[..., diagonal, diagonal], axis=1, keepdims=True)
        H[..., diagonal, diagonal] += REGULAR * (scale + REGULAR * np.max(scale, axis=2, keepdims=True)) + 1e-300
        reach, wrench = task.support(u.reshape(-1, u.shape[2]))
        reach = reach.reshape(u.shape[:2])
        ratio = np.maximum(value, 0.0) ** (1.0 / power) / np.where(reach > 0.0, reach, 1.0)
        return np.where(reach > 0.0, ratio, np.inf), wrench.reshape(u.shape), H

    u, value = descend(model, twists, steps)
    return normalised(task, u), value
