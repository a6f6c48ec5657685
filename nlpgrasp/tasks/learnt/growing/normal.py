"""The ellipsoid that holds a share of normally distributed wrenches, updated exactly from their moments alone."""

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
    """The ellipsoid of the wrenches' covariance, that of ``fit_ellipsoid(wrenches, probability=...)`` of all at once.

    Parameters
    ----------
    center, axes, moments, forgotten
        See ``Learnt``.
    probability : float
        Share of normally distributed wrenches that it holds.
    """

    kind: ClassVar[str] = "probability"
    probability: float

    @classmethod
    def of(cls, moments: Moments, probability: float) -> Normal:
        """Return the ellipsoid of wrenches with these moments.

        Raises
        ------
        InputError
            On a probability that is none, or wrenches that do not differ.
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
        """Return which share it holds."""
        return f"of {self.probability:.6g} of normally distributed wrenches, from {self.wrenches}"

    def updated(self, rows: FloatArray) -> Normal:
        """Return the ellipsoid of all wrenches of before and these, exactly."""
        return Normal.of(self.moments.plus(Moments.of(rows)), self.probability)

    def merged(self, other: Learnt) -> Normal:
        """Return the ellipsoid of all wrenches of both, exactly."""
        self.check_alike(other)
        if not isinstance(other, Normal) or other.probability != self.probability:
            raise InputError("fit", other.words(), f"probability {self.probability}, that of the other")
        return Normal.of(self.moments.plus(other.moments), self.probability)

    def without_outliers(self, share: float) -> tuple[Normal, FloatArray]:
        """Refuse: no wrench is kept of which to say that it is an outlier."""
        raise InputError("share", share, "an entry of least volume: this one keeps mean and covariance, no wrenches")

    def to_dict(self) -> Json:
        """Return probability and moments."""
        return {
            "kind": self.kind,
            "probability": self.probability,
            "forgotten": self.forgotten,
            "moments": self.moments.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> Normal:
        """Return what ``to_dict`` wrote."""
        moments = Moments.from_dict(data["moments"], task.dimension)
        return cls(task.center, task.axes, moments, data["forgotten"], data["probability"])
