"""Running moments of wrenches: count, mean and scatter matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array


@dataclass(frozen=True)
class Moments:
    """Count, mean and scatter matrix ``sum_i (w_i - mean) (w_i - mean)^T`` of wrenches.

    Parameters
    ----------
    count : int
    mean : (d,) array
    scatter : (d, d) array
    """

    count: int
    mean: FloatArray
    scatter: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> Moments:
        """Return the moments of wrenches (n, d), zero if there are none."""
        mean = rows.mean(axis=0) if len(rows) else np.zeros(rows.shape[1])
        away = rows - mean
        return cls(len(rows), mean, away.T @ away)

    def plus(self, other: Moments) -> Moments:
        """Return the moments of both sets together (Chan, Golub and LeVeque 1983, doi:10.2307/2683386)."""
        count = self.count + other.count
        if count == 0:
            return self
        between = other.mean - self.mean
        spread = self.count * other.count / count * np.outer(between, between)
        return Moments(count, self.mean + between * other.count / count, self.scatter + other.scatter + spread)

    def minus(self, other: Moments) -> Moments:
        """Return the moments without those of a subset."""
        count = self.count - other.count
        if count <= 0:
            return Moments.of(np.zeros((0, len(self.mean))))
        mean = (self.count * self.mean - other.count * other.mean) / count
        between = other.mean - mean
        spread = count * other.count / self.count * np.outer(between, between)
        return Moments(count, mean, self.scatter - other.scatter - spread)

    def to_dict(self) -> Json:
        """Return count, mean and scatter as JSON data."""
        return {"count": self.count, "mean": self.mean.tolist(), "scatter": self.scatter.tolist()}

    @classmethod
    def from_dict(cls, data: Json, dimension: int) -> Moments:
        """Return the moments from the data of ``to_dict``, checked against the dimension."""
        mean = array("fit.moments.mean", data["mean"], (dimension,))
        return cls(data["count"], mean, array("fit.moments.scatter", data["scatter"], (dimension, dimension)))
