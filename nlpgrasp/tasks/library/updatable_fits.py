"""Ellipsoids fitted to wrenches that can be updated with further ones: minimum-volume or covariance.

A minimum-volume ellipsoid (``MinVolumeFit``) keeps all wrenches, and an update is a fit of all of them. A covariance
ellipsoid (``CovarianceFit``) follows exactly from the count, mean and scatter of all wrenches (``Moments``).
"""

from __future__ import annotations

import base64
import binascii
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.special import gammaincinv

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.enclosing_ellipsoid import (
    FLAT,
    INSIDE,
    NormalisedWrenches,
    ellipsoid_norms,
    enclose_without_outliers,
)
from nlpgrasp.tasks.library.outer_ellipsoid import GAP, InnerEllipsoid, OuterEllipsoid, enclose_wrenches
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid

NUMBERS = np.dtype("<f8")  # number format of wrenches in files of earlier versions


@dataclass(frozen=True)
class UpdatableFit(ABC):
    """Immutable ellipsoid fitted to wrenches, with the data that an update needs.

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
    forgotten : int
        Number of wrenches removed as outliers, which are not counted elsewhere.
    """

    kind: ClassVar[str]
    center: FloatArray
    axes: FloatArray
    forgotten: int

    @property
    def task(self) -> TaskEllipsoid:
        """The ellipsoid as a task."""
        return TaskEllipsoid.from_axes(self.axes, self.center)

    @property
    def dimension(self) -> int:
        """Dimension of wrench space."""
        return len(self.center)

    @property
    @abstractmethod
    def wrench_count(self) -> int:
        """Number of wrenches that the ellipsoid was fitted to."""

    @property
    def stored_wrenches(self) -> FloatArray:
        """Wrenches that an update needs individually, (n, d)."""
        return np.zeros((0, self.dimension))

    @abstractmethod
    def describe(self) -> str:
        """Return a text that describes the fit."""

    @abstractmethod
    def updated(self, rows: FloatArray) -> Self:
        """Return the fit to all previous and new wrenches (n, d)."""

    @abstractmethod
    def merged(self, other: UpdatableFit) -> Self:
        """Return the fit to the wrenches of both fits."""

    @abstractmethod
    def without_outliers(self, share: float) -> tuple[Self, FloatArray]:
        """Return the fit without a fraction ``share`` of outliers, and the removed wrenches (k, d)."""

    @abstractmethod
    def to_dict(self) -> Json:
        """Return ``kind`` and the statistics for updates as JSON data, without ellipsoid and stored wrenches."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid, stored: FloatArray | None) -> Self:
        """Return the fit from the data of its ``to_dict``, its ellipsoid and the stored wrenches (n, d), if any.

        Raises
        ------
        InputError
            When the data do not match the task, with the field.
        """

    def check_alike(self, other: UpdatableFit) -> None:
        """Raise if the other ellipsoid has another dimension."""
        if other.dimension != self.dimension:
            raise InputError("dimension", other.dimension, f"{self.dimension}, that of the other")


@dataclass(frozen=True)
class MinVolumeFit(UpdatableFit):
    """Minimum-volume ellipsoid around wrenches and given task ellipsoids.

    Parameters
    ----------
    center, axes, forgotten
        See ``UpdatableFit``.
    gap : float or None
        Certified relative excess of its volume over the minimum; ``None`` if unknown.
    rows : (n, d) array
        The wrenches.
    inner : tuple of InnerEllipsoid
        Ellipsoids that stay inside.
    unstored : int
        Number of further wrenches, known from inner ellipsoids only: those that earlier versions discarded.
    """

    kind: ClassVar[str] = "least volume"
    gap: float | None
    rows: FloatArray
    inner: tuple[InnerEllipsoid, ...] = ()
    unstored: int = 0

    @classmethod
    def of(cls, rows: FloatArray) -> MinVolumeFit:
        """Return the minimum-volume ellipsoid around wrenches (n, d)."""
        outer = enclose_wrenches(rows, ())
        return cls(outer.center, outer.axes, 0, outer.gap, rows)

    @classmethod
    def of_task(cls, task: TaskEllipsoid) -> MinVolumeFit:
        """Return the fit that starts with a given task ellipsoid, which all updates enclose."""
        inner = InnerEllipsoid(task.center, task.axes)
        return cls(task.center, task.axes, 0, 0.0, np.zeros((0, task.dimension)), (inner,))

    @property
    def wrench_count(self) -> int:
        """Number of wrenches that the ellipsoid was fitted to."""
        return len(self.rows) + self.unstored

    @property
    def stored_wrenches(self) -> FloatArray:
        """Wrenches of the fit, (n, d)."""
        return self.rows

    def describe(self) -> str:
        """Return a text that describes the fit by its certified volume."""
        if not self.wrench_count:
            return "as given"
        excess = "not known" if self.gap is None else f"at most {self.gap:.1g} above the least"
        return f"of least volume around {self.wrench_count} wrenches, {excess}"

    def updated(self, rows: FloatArray) -> MinVolumeFit:
        """Return the minimum-volume ellipsoid around all previous and new wrenches (n, d)."""
        return replace(self, rows=np.concatenate([self.rows, rows]))._refitted(self)

    def merged(self, other: UpdatableFit) -> MinVolumeFit:
        """Return the minimum-volume ellipsoid around the wrenches and the given tasks of both fits."""
        self.check_alike(other)
        if not isinstance(other, MinVolumeFit):
            raise InputError("fit.kind", other.kind, f"{self.kind!r}, that of the other")
        union = replace(
            self,
            forgotten=self.forgotten + other.forgotten,
            rows=np.concatenate([self.rows, other.rows]),
            inner=self.inner + other.inner,
            unstored=self.unstored + other.unstored,
        )
        return union._refitted(self)

    def _refitted(self, previous: MinVolumeFit | None) -> MinVolumeFit:
        """Return the fit with the ellipsoid of all its wrenches: a previous one if it contains them, else a new one."""
        former = None if previous is None else OuterEllipsoid(previous.center, previous.axes, previous.gap)
        outer = enclose_wrenches(self.rows, self.inner, former)
        return replace(self, center=outer.center, axes=outer.axes, gap=None if self.unstored else outer.gap)

    def without_outliers(self, share: float) -> tuple[MinVolumeFit, FloatArray]:
        """Return the minimum-volume fit without a fraction ``share`` of outliers, and the removed wrenches (k, d).

        The farthest wrenches are trimmed iteratively, as by ``fit_ellipsoid``.

        Raises
        ------
        InputError
            On a share of half or more, or one that leaves wrenches that do not span.
        """
        count = int(check_outlier_share(share) * self.wrench_count)
        if count == 0:
            return self, self.rows[:0]
        if 2 * count >= len(self.rows):
            largest = (len(self.rows) - 1) / 2 / self.wrench_count
            raise InputError("share", share, f"at most {largest:.3g}: {len(self.rows)} wrenches are kept one by one")
        local = NormalisedWrenches.of(self.rows)
        ellipsoid = enclose_without_outliers(local.points, (count + 0.5) / len(self.rows), GAP, False)
        is_inside = ellipsoid_norms(local.points, ellipsoid.center, ellipsoid.axes) <= 1.0 + INSIDE
        outliers = self.rows[~is_inside]
        trimmed = replace(self, rows=self.rows[is_inside], forgotten=self.forgotten + len(outliers))
        return trimmed._refitted(None), outliers

    def to_dict(self) -> Json:
        """Return gap, counts and inner ellipsoids as JSON data."""
        return {
            "kind": self.kind,
            "gap": self.gap,
            "forgotten": self.forgotten,
            "count": self.wrench_count,
            "inner": [ellipsoid.to_dict() for ellipsoid in self.inner],
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid, stored: FloatArray | None) -> MinVolumeFit:
        """Return the fit of a task ellipsoid from its stored data and wrenches.

        The data are those of ``to_dict`` of this or of an earlier version.
        """
        d = task.dimension
        if "kept" in data:
            rows, count, inner = _read_earlier_data(data, d)
        else:
            rows, count = np.zeros((0, d)) if stored is None else stored, data["count"]
            inner = [InnerEllipsoid.from_dict(item, d, f"fit.inner.{i}") for i, item in enumerate(data["inner"])]
        if len(rows) > count or not len(rows) + len(inner):
            field = "fit.kept" if "kept" in data else "fit.wrenches"
            raise InputError(field, f"{len(rows)} wrenches", f"wrenches or ellipsoids, at most {count}")
        return cls(task.center, task.axes, data["forgotten"], data["gap"], rows, tuple(inner), count - len(rows))


def _read_earlier_data(data: Json, dimension: int) -> tuple[FloatArray, int, list[InnerEllipsoid]]:
    """Return wrenches (n, d), their number and inner ellipsoids from data in the format of earlier versions.

    Earlier versions kept a limited number of wrenches, and replaced the others by intersections of ellipsoids. The
    smallest ellipsoid of each intersection stands for it.
    """
    inner = []
    for i, cover in enumerate(data["covers"]):
        shapes = [
            InnerEllipsoid.from_dict(shape, dimension, f"fit.covers.{i}.in.{j}") for j, shape in enumerate(cover["in"])
        ]
        inner.append(min(shapes, key=lambda shape: (len(shape.axes), np.prod(np.linalg.svd(shape.axes)[1]))))
    array("fit.moments.mean", data["moments"]["mean"], (dimension,))
    return _decode_wrenches(data["kept"], dimension), data["moments"]["count"], inner


def _decode_wrenches(text: str, dimension: int) -> FloatArray:
    """Decode wrenches (n, d) from base64 text."""
    try:
        content = base64.b64decode(text, validate=True)
    except binascii.Error:
        raise InputError("fit.kept", "a text that is not base64", "numbers in base64") from None
    row = dimension * NUMBERS.itemsize
    if len(content) % row:
        raise InputError("fit.kept", f"{len(content)} bytes", f"rows of {row}: {dimension} numbers a wrench")
    return array("fit.kept", np.frombuffer(content, NUMBERS).reshape(-1, dimension), (None, dimension))


def check_outlier_share(share: float) -> float:
    """Return the validated fraction of outliers, above 0 and below 0.5."""
    if number("share", share, above=0.0) >= 0.5:
        raise InputError("share", share, "a share below 0.5")
    return float(share)


@dataclass(frozen=True)
class CovarianceFit(UpdatableFit):
    """Covariance ellipsoid, equal to ``fit_ellipsoid(wrenches, probability=...)`` of all wrenches.

    Parameters
    ----------
    center, axes, forgotten
        See ``UpdatableFit``.
    moments : Moments
        Of all wrenches.
    probability : float
        Share of normally distributed wrenches that it contains.
    """

    kind: ClassVar[str] = "probability"
    moments: Moments
    probability: float

    @classmethod
    def of(cls, moments: Moments, probability: float) -> CovarianceFit:
        """Return the covariance ellipsoid of wrenches with given count, mean and scatter.

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
        spanned = values > FLAT**2 * values[-1]
        quantile = 2.0 * gammaincinv(0.5 * int(np.count_nonzero(spanned)), float(probability))  # of chi squared
        axes = np.sqrt(quantile * values[spanned])[:, None] * vectors[:, spanned].T * unit
        return cls(moments.mean, axes[::-1], 0, moments, float(probability))

    @property
    def wrench_count(self) -> int:
        """Number of wrenches that the ellipsoid was fitted to."""
        return self.moments.count

    def describe(self) -> str:
        """Return a text that describes the fit by its probability."""
        return f"of {self.probability:.6g} of normally distributed wrenches, from {self.wrench_count}"

    def updated(self, rows: FloatArray) -> CovarianceFit:
        """Return the covariance ellipsoid of all previous and new wrenches (n, d)."""
        return CovarianceFit.of(self.moments.plus(Moments.of(rows)), self.probability)

    def merged(self, other: UpdatableFit) -> CovarianceFit:
        """Return the covariance ellipsoid of the wrenches of both fits."""
        self.check_alike(other)
        if not isinstance(other, CovarianceFit) or other.probability != self.probability:
            raise InputError("fit", other.describe(), f"probability {self.probability}, that of the other")
        return CovarianceFit.of(self.moments.plus(other.moments), self.probability)

    def without_outliers(self, share: float) -> tuple[CovarianceFit, FloatArray]:
        """Raise: no individual wrenches are kept, so none can be removed."""
        raise InputError("share", share, "an entry of least volume: this one keeps mean and covariance, no wrenches")

    def to_dict(self) -> Json:
        """Return probability, count, mean and scatter as JSON data."""
        return {
            "kind": self.kind,
            "probability": self.probability,
            "forgotten": self.forgotten,
            "moments": self.moments.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid, stored: FloatArray | None) -> CovarianceFit:
        """Return the fit from the data of its ``to_dict`` and its ellipsoid."""
        del stored
        moments = Moments.from_dict(data["moments"], task.dimension)
        return cls(task.center, task.axes, data["forgotten"], moments, data["probability"])


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
        """Return count, mean and scatter of wrenches (n, d)."""
        mean = rows.mean(axis=0)
        deviations = rows - mean
        return cls(len(rows), mean, deviations.T @ deviations)

    def plus(self, other: Moments) -> Moments:
        """Return count, mean and scatter of both sets of wrenches together.

        Formulas of Chan, Golub and LeVeque (1983, doi:10.2307/2683386).
        """
        count = self.count + other.count
        difference = other.mean - self.mean
        spread = self.count * other.count / count * np.outer(difference, difference)
        return Moments(count, self.mean + difference * other.count / count, self.scatter + other.scatter + spread)

    def to_dict(self) -> Json:
        """Return count, mean and scatter as JSON data."""
        return {"count": self.count, "mean": self.mean.tolist(), "scatter": self.scatter.tolist()}

    @classmethod
    def from_dict(cls, data: Json, dimension: int) -> Moments:
        """Return count, mean and scatter from the data of ``to_dict``, checked against the dimension."""
        mean = array("fit.moments.mean", data["mean"], (dimension,))
        return cls(data["count"], mean, array("fit.moments.scatter", data["scatter"], (dimension, dimension)))
