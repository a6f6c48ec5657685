"""Coordinates in which wrenches differ alike in every direction.

Forces and torques have different units, and wrenches may not differ in every direction: both are taken out first, each
component over its own extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

FLAT = 1e-7  # of the largest extent, each component over its own: directions thinner than this have none
ROUNDING = 1e-12  # of a component's size: an extent this small is none


@dataclass(frozen=True)
class Local:
    """Wrenches in coordinates in which they differ alike in every direction: ``about + (points @ basis) * unit``.

    Parameters
    ----------
    points : (n, r) array
    about, unit : (d,) array
    basis : (r, d) array
    flat : (d - r, d) array
        The directions left out.
    """

    points: FloatArray
    about: FloatArray
    unit: FloatArray
    basis: FloatArray
    flat: FloatArray

    @classmethod
    def of(cls, rows: FloatArray, middle: FloatArray | None = None) -> Local:
        """Return the coordinates of wrenches (n, d), about their mean or about a given middle.

        Raises
        ------
        InputError
            When all wrenches are the same.
        """
        about = rows[0] + (rows - rows[0]).mean(axis=0) if middle is None else middle  # exact where all are the same
        extent = np.max(np.abs(rows - about), axis=0)
        varies = extent > ROUNDING * np.max(np.abs(rows), axis=0)
        if not np.any(varies):
            raise InputError("wrenches", f"{len(rows)} wrenches, all {rows[0].tolist()}", "wrenches that differ")
        unit = np.where(varies, extent, 1.0)
        scaled = np.where(varies, (rows - about) / unit, 0.0)
        _, sizes, basis = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
        sizes = np.append(sizes, np.zeros(max(0, rows.shape[1] - len(sizes)))) / np.sqrt(len(rows))
        used = sizes > FLAT * sizes[0]
        return cls(scaled @ basis[used].T, about, unit, basis[used], basis[~used])

    def inward(self, rows: FloatArray) -> FloatArray:
        """Return wrenches (n, d) in these coordinates, (n, r)."""
        return np.asarray(((rows - self.about) / self.unit) @ self.basis.T)

    def inward_axes(self, axes: FloatArray) -> FloatArray:
        """Return differences of wrenches (m, d) in these coordinates, (m, r)."""
        return np.asarray((axes / self.unit) @ self.basis.T)

    def outward(self, point: FloatArray) -> FloatArray:
        """Return the wrench (d,) of a point (r,)."""
        return np.asarray(self.about + (point @ self.basis) * self.unit)

    def outward_axes(self, axes: FloatArray) -> FloatArray:
        """Return the differences of wrenches (m, d) of differences of points (m, r)."""
        return np.asarray((axes @ self.basis) * self.unit)
