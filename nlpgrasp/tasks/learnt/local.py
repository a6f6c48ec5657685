"""Normalised coordinates of wrenches: components scaled by extent, without flat directions.

Forces and torques have different units, and wrenches may not span all directions: each component is divided by its
extent, and the directions along which the wrenches are constant are removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

FLAT = 1e-7  # of the largest normalised extent: directions of smaller extent are flat
ROUNDING = 1e-12  # of a component's size: extent that counts as zero


@dataclass(frozen=True)
class Local:
    """Wrenches in normalised coordinates: ``about + (points @ basis) * unit``.

    Parameters
    ----------
    points : (n, r) array
    about, unit : (d,) array
    basis : (r, d) array
    flat : (d - r, d) array
        The removed directions.
    """

    points: FloatArray
    about: FloatArray
    unit: FloatArray
    basis: FloatArray
    flat: FloatArray

    @classmethod
    def of(cls, rows: FloatArray, middle: FloatArray | None = None) -> Local:
        """Return the normalised coordinates of wrenches (n, d), about their mean or a given centre.

        Raises
        ------
        InputError
            When all wrenches are equal.
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
        """Map wrenches (n, d) to normalised coordinates (n, r)."""
        return np.asarray(((rows - self.about) / self.unit) @ self.basis.T)

    def inward_axes(self, axes: FloatArray) -> FloatArray:
        """Map differences of wrenches (m, d) to normalised coordinates (m, r)."""
        return np.asarray((axes / self.unit) @ self.basis.T)

    def outward(self, point: FloatArray) -> FloatArray:
        """Map a point (r,) in normalised coordinates to a wrench (d,)."""
        return np.asarray(self.about + (point @ self.basis) * self.unit)

    def outward_axes(self, axes: FloatArray) -> FloatArray:
        """Map differences of points (m, r) to differences of wrenches (m, d)."""
        return np.asarray((axes @ self.basis) * self.unit)
