"""Incremental covariance ellipsoid for normally distributed wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import gammaincinv

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.growing.base import Learnt
from nlpgrasp.tasks.learnt.growing.moments import Moments
from nlpgrasp.tasks.learnt.local import FLAT


@dataclass(frozen=True)
class Normal(Learnt):
    """Covariance ellipsoid, equal to ``fit_ellipsoid(wrenches, probability=...)`` of all wrenches.

    Parameters
    ----------
    center, axes, moments, forgotten
        See ``Learnt``.
    probability : float
        Share of normally distributed wrenches that it contains.
    """

    kind: ClassVar[str] = "probability"
    probability: float

    @classmethod
    def of(cls, moments: Moments, probability: float) -> Normal:
        """Return the covariance ellipsoid of given moments.

        Raises
        ------
        InputError
            On an invalid probability, or wrenches that are all equal.
        """
        if not 0.0 < number("probability", probability) < 1.0:
            raise InputError("probability", probability, "a share between 0 and 1")
        covariance = moments.scatter / max(moments.count - 1, 1)
        unit = np.sqrt(np.diag(covariance))
        if not np.any(unit > 0.0):
            raise InputError("wrenches", f"{moments.count} wrenches, all the same", "wrenches that differ")
        unit = np.where(unit > 0.0, unit, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
        used = values > FLAT**2 * values[-1]
        quantile = 2.0 * gammaincinv(0.5 * int(np.count_nonzero(used)), float(probability))  # of chi squared
        axes = np.sqrt(quantile * values[used])[:, None] * vectors[:, used].T * unit
        return cls(moments.mean, axes[::-1], moments, 0, float(probability))

    def words(self) -> str:
        """Return a text on the share that it contains."""
        return f"of {self.probability:.6g} of normally distributed wrenches, from {self.wrenches}"

    def updated(self, rows: FloatArray) -> Normal:
        """Return the exact ellipsoid of all previous and new wrenches (n, d)."""
        return Normal.of(self.moments.plus(Moments.of(rows)), self.probability)

    def merged(self, other: Learnt) -> Normal:
        """Return the exact ellipsoid of all wrenches of both."""
        self.check_alike(other)
        if not isinstance(other, Normal) or other.probability != self.probability:
            raise InputError("fit", other.words(), f"probability {self.probability}, that of the other")
        return Normal.of(self.moments.plus(other.moments), self.probability)

    def without_outliers(self, share: float) -> tuple[Normal, FloatArray]:
        """Raise: no individual wrenches are kept, so none can be removed."""
        raise InputError("share", share, "an entry of least volume: this one keeps mean and covariance, no wrenches")

    def to_dict(self) -> Json:
        """Return probability and moments as JSON data."""
        return {
            "kind": self.kind,
            "probability": self.probability,
            "forgotten": self.forgotten,
            "moments": self.moments.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> Normal:
        """Return the fit from the data of its ``to_dict`` and its ellipsoid."""
        moments = Moments.from_dict(data["moments"], task.dimension)
        return cls(task.center, task.axes, moments, data["forgotten"], data["probability"])
