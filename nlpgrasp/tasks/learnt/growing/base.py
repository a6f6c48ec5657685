"""What every way to learn an ellipsoid from recordings has in common."""

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
    """An ellipsoid and what it takes to update it; frozen: updates are new ones.

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
    moments : Moments
        Of all wrenches that it is learnt from.
    forgotten : int
        Wrenches that were left out as outliers; they are in nothing else.
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
        """How many wrenches it is learnt from."""
        return self.moments.count

    @abstractmethod
    def words(self) -> str:
        """Return in words what kind of ellipsoid it is."""

    @abstractmethod
    def updated(self, rows: FloatArray) -> Self:
        """Return the ellipsoid of all wrenches of before and these (n, d)."""

    @abstractmethod
    def merged(self, other: Learnt) -> Self:
        """Return the ellipsoid of all wrenches of both."""

    @abstractmethod
    def without_outliers(self, share: float) -> tuple[Self, FloatArray]:
        """Return the ellipsoid of all but a share of the wrenches, and those that were left out (k, d)."""

    @abstractmethod
    def to_dict(self) -> Json:
        """Return all but the ellipsoid itself as JSON data; ``kind`` among them."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> Self:
        """Return what ``to_dict`` wrote.

        Raises
        ------
        InputError
            With the field, when the data do not fit the task.
        """

    def check_alike(self, other: Learnt) -> None:
        """Refuse to merge with an ellipsoid of another dimension."""
        if other.dimension != self.dimension:
            raise InputError("dimension", other.dimension, f"{self.dimension}, that of the other")


def outlier_share(share: float) -> float:
    """Return a share of wrenches that may be left out."""
    if number("share", share, above=0.0) >= 0.5:
        raise InputError("share", share, "a share below 0.5")
    return float(share)
