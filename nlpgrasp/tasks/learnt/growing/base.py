"""Base class of incrementally fitted ellipsoids."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.growing.moments import Moments


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


def outlier_share(share: float) -> float:
    """Return a validated share of outliers, above 0 and below 0.5."""
    if number("share", share, above=0.0) >= 0.5:
        raise InputError("share", share, "a share below 0.5")
    return float(share)
