"""Incremental enclosing ellipsoids of growing sets of wrenches: minimum-volume, or from a covariance.

A covariance ellipsoid (``Normal``) follows exactly from the count, mean and scatter of all wrenches (``Moments``).

For a minimum-volume ellipsoid (``LeastVolume``) up to ``MOST`` wrenches are kept individually: as long as there are no
more, an update is a fit of all. When there are more, the innermost are discarded until ``LEAST`` are left. The current
ellipsoid, shrunk to the outermost of those discarded, becomes a cover that represents them, together with their
covariance ellipsoid, which stays small if the former was stretched by outliers that are removed later.

Guarantees of ``LeastVolume``:

- Every wrench that was given and not removed is inside, to 1e-9 of the ellipsoid's size (across a flat ellipsoid, to
  1e-7 of the wrenches' extents). By induction each is kept or in a cover: wrenches discarded at one time are in their
  cover, which never changes and is dropped only when it lies in a new one. The updated ellipsoid contains the kept
  wrenches, and the covers by an upper bound of their level (``Cover.farthest``).
- Its volume is at most ``1 + gap`` times the minimum around all of them. The dual weights bound the minimum volume
  around the kept wrenches from below, hence also that around all. Covers that extend beyond that ellipsoid enlarge it
  more than necessary; the gap says by how much.

The gap has no a-priori bound: no summary of bounded size has one in six dimensions, where millions of points are
needed to approximate a ball to 0.2 % of its radius. If wrenches come from one distribution or drift, covers lie deep
inside later ellipsoids, and the gap stays that of the search, 1e-5.
"""

from __future__ import annotations

import base64
import binascii
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.special import gammaincinv

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid_covers import GAP, Around, Cover, Shape, least_around
from nlpgrasp.tasks.enclosing_ellipsoid import (
    FLAT,
    NEAR,
    ROUNDING,
    NormalisedWrenches,
    enclose_without_outliers,
    levels,
)
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid

MOST, LEAST = 8192, 4096  # wrenches kept individually: most, and number after thinning
NUMBERS = np.dtype("<f8")  # number format of kept wrenches in files


@dataclass(frozen=True)
class Learnt(ABC):
    """An incrementally fitted ellipsoid: its shape and the statistics for updates (immutable).

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
    moments : Moments
        Of all wrenches that it was fitted to.
    forgotten : int
        Number of wrenches removed as outliers, which are not counted elsewhere.
    """

    kind: ClassVar[str]
    center: FloatArray
    axes: FloatArray
    moments: Moments
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
    def wrenches(self) -> int:
        """Number of wrenches that it was fitted to."""
        return self.moments.count

    @abstractmethod
    def words(self) -> str:
        """Return a text that describes the fit."""

    @abstractmethod
    def updated(self, rows: FloatArray) -> Self:
        """Return the fit to all previous and new wrenches (n, d)."""

    @abstractmethod
    def merged(self, other: Learnt) -> Self:
        """Return the fit to all wrenches of both."""

    @abstractmethod
    def without_outliers(self, share: float) -> tuple[Self, FloatArray]:
        """Return the fit without a share of outliers, and the removed wrenches (k, d)."""

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the ``kind`` and the statistics for updates as JSON data, without the ellipsoid."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> Self:
        """Return the fit from the data of its ``to_dict`` and its ellipsoid.

        Raises
        ------
        InputError
            When the data do not match the task, with the field.
        """

    def check_alike(self, other: Learnt) -> None:
        """Raise if the other ellipsoid has another dimension."""
        if other.dimension != self.dimension:
            raise InputError("dimension", other.dimension, f"{self.dimension}, that of the other")


@dataclass(frozen=True)
class LeastVolume(Learnt):
    """Incremental minimum-volume ellipsoid around wrenches and given task ellipsoids.

    Parameters
    ----------
    center, axes, moments, forgotten
        See ``Learnt``.
    gap : float or None
        Certified relative excess of its volume over the minimum; ``None`` if unknown.
    kept : (n, d) array
        Wrenches kept individually.
    covers : tuple of Cover
        Covers of the discarded wrenches and given ellipsoids.
    """

    kind: ClassVar[str] = "least volume"
    gap: float | None
    kept: FloatArray
    covers: tuple[Cover, ...]

    @classmethod
    def of(cls, rows: FloatArray) -> LeastVolume:
        """Return the minimum-volume ellipsoid around wrenches (n, d)."""
        nothing = rows[:0]
        around = least_around(rows, (), None)
        return cls._made(around, Moments.of(nothing), 0, nothing, ())._with(rows, (), Moments.of(rows))

    @classmethod
    def of_task(cls, task: TaskEllipsoid) -> LeastVolume:
        """Return a fit that starts from a given task ellipsoid, which updates will enclose too."""
        none = Moments.of(np.zeros((0, task.dimension)))
        cover = Cover((Shape(task.center, task.axes),), given=True)
        return cls(task.center, task.axes, none, 0, 0.0, np.zeros((0, task.dimension)), (cover,))

    @classmethod
    def _made(
        cls, around: Around, moments: Moments, forgotten: int, kept: FloatArray, covers: tuple[Cover, ...]
    ) -> LeastVolume:
        return cls(around.center, around.axes, moments, forgotten, around.gap, kept, covers)

    def words(self) -> str:
        """Return a text on the certified volume."""
        if not self.wrenches:
            return "as given"
        known = "not known" if self.gap is None else f"at most {self.gap:.1g} above the least"
        return f"of least volume around {self.wrenches} wrenches, {known}"

    def updated(self, rows: FloatArray) -> LeastVolume:
        """Return the minimum-volume ellipsoid around all previous and new wrenches."""
        return self._with(rows, (), Moments.of(rows))

    def merged(self, other: Learnt) -> LeastVolume:
        """Return the minimum-volume ellipsoid around all wrenches and given tasks of both."""
        self.check_alike(other)
        if not isinstance(other, LeastVolume):
            raise InputError("fit.kind", other.kind, f"{self.kind!r}, that of the other")
        merged = self._with(other.kept, other.covers, other.moments)
        return self._made(
            Around(merged.center, merged.axes, merged.gap),
            merged.moments,
            self.forgotten + other.forgotten,
            merged.kept,
            merged.covers,
        )

    def _with(self, rows: FloatArray, covers: tuple[Cover, ...], moments: Moments) -> LeastVolume:
        """Return the minimum-volume ellipsoid around its own contents, more wrenches and more covers."""
        kept, all_covers = np.concatenate([self.kept, rows]), self.covers + covers
        around = least_around(kept, all_covers, Around(self.center, self.axes, self.gap))
        kept, all_covers = _thinned(kept, all_covers, around)
        return self._made(around, self.moments.plus(moments), self.forgotten, kept, all_covers)

    def without_outliers(self, share: float) -> tuple[LeastVolume, FloatArray]:
        """Return the minimum-volume ellipsoid without a share of outliers, and the removed wrenches (k, d).

        The farthest wrenches are trimmed iteratively, as by ``fit_ellipsoid``; only wrenches kept individually, which
        include the outermost, can be removed.

        Raises
        ------
        InputError
            On a share of half or more of those, or one that leaves wrenches that do not span.
        """
        many = int(outlier_share(share) * self.wrenches)
        if many == 0:
            return self, self.kept[:0]
        if 2 * many >= len(self.kept):
            most = (len(self.kept) - 1) / 2 / self.wrenches
            raise InputError("share", share, f"at most {most:.3g}: {len(self.kept)} wrenches are kept one by one")
        local = NormalisedWrenches.of(self.kept)
        found = enclose_without_outliers(local.points, (many + 0.5) / len(self.kept), GAP, False)
        inside = levels(local.points, found.center, found.axes) <= 1.0 + NEAR
        left, out = self.kept[inside], self.kept[~inside]
        around = least_around(left, self.covers, None)
        moments = self.moments.minus(Moments.of(out))
        return self._made(around, moments, self.forgotten + len(out), left, self.covers), out

    def to_dict(self) -> Json:
        """Return the fit as JSON data; kept wrenches as little-endian doubles in base64, row by row."""
        text = base64.b64encode(np.ascontiguousarray(self.kept, dtype=NUMBERS).tobytes()).decode("ascii")
        return {
            "kind": self.kind,
            "gap": self.gap,
            "forgotten": self.forgotten,
            "moments": self.moments.to_dict(),
            "covers": [cover.to_dict() for cover in self.covers],
            "kept": text,
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> LeastVolume:
        """Return the fit from the data of its ``to_dict`` and its ellipsoid."""
        d = task.dimension
        covers = tuple(Cover.from_dict(one, d, f"fit.covers.{i}") for i, one in enumerate(data["covers"]))
        moments = Moments.from_dict(data["moments"], d)
        kept = _kept(data["kept"], d)
        if len(kept) > moments.count or not len(kept) + len(covers):
            raise InputError("fit.kept", f"{len(kept)} wrenches", f"wrenches or covers, at most {moments.count}")
        return cls(task.center, task.axes, moments, data["forgotten"], data["gap"], kept, covers)


def _kept(text: str, dimension: int) -> FloatArray:
    """Decode kept wrenches (n, d) from base64 text."""
    try:
        content = base64.b64decode(text, validate=True)
    except binascii.Error:
        raise InputError("fit.kept", "a text that is not base64", "numbers in base64") from None
    row = dimension * NUMBERS.itemsize
    if len(content) % row:
        raise InputError("fit.kept", f"{len(content)} bytes", f"rows of {row}: {dimension} numbers a wrench")
    return array("fit.kept", np.frombuffer(content, NUMBERS).reshape(-1, dimension), (None, dimension))


def _thinned(kept: FloatArray, covers: Sequence[Cover], around: Around) -> tuple[FloatArray, tuple[Cover, ...]]:
    """Return wrenches and covers, with the innermost wrenches replaced by a cover if there are too many."""
    if len(kept) > MOST:
        kept = np.unique(kept, axis=0)
    if len(kept) <= MOST:
        return kept, tuple(covers)
    local = NormalisedWrenches.of(np.concatenate([kept, *(cover.ends() for cover in covers)]))
    ellipsoid = around.within(local)
    if ellipsoid is None:  # rounding at the edge of being flat
        return kept, tuple(covers)
    level = levels(local.inward(kept), ellipsoid.center, ellipsoid.axes)
    order = np.argsort(level, kind="stable")
    inner = kept[order[:-LEAST]]
    rho = float(level[order[-LEAST - 1]])
    made = Cover((Shape(around.center, rho * around.axes), _shaped(inner)))
    shrunk = replace(ellipsoid, axes=rho * ellipsoid.axes)
    others = [c for c in covers if c.given or c.within(local).farthest(shrunk)[0] > 1.0]
    return kept[np.sort(order[-LEAST:])], (*others, made)


def _shaped(rows: FloatArray) -> Shape:
    """Return an enclosing ellipsoid of wrenches (n, d) with the shape of their covariance."""
    local = NormalisedWrenches.of(rows)
    values, vectors = np.linalg.eigh(local.points.T @ local.points / len(rows))
    axes = np.sqrt(values)[:, None] * vectors.T
    reach = float(np.max(levels(local.points, np.zeros(len(values)), axes))) * (1.0 + ROUNDING)
    return Shape(local.about, local.outward_axes(reach * axes))


def outlier_share(share: float) -> float:
    """Return a validated share of outliers, above 0 and below 0.5."""
    if number("share", share, above=0.0) >= 0.5:
        raise InputError("share", share, "a share below 0.5")
    return float(share)


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
