"""Fits of task ellipsoids to recorded wrenches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.enclosing import GAP, Enclosing, enclose


@dataclass(frozen=True)
class EllipsoidFit:
    """A task ellipsoid fitted to wrenches, with its certified gap.

    Parameters
    ----------
    task : TaskEllipsoid
        The fitted ellipsoid.
    inside : (m,) bool array
        Which wrenches it contains.
    gap : float or None
        Certified relative excess of its volume over the minimum around the wrenches it was fitted to; ``None`` for a
        covariance.
    flat : (s, d) array
        Unit directions, components normalised by their extents, along which the wrenches are constant.
    """

    task: TaskEllipsoid
    inside: NDArray[np.bool_]
    gap: float | None
    flat: FloatArray

    @classmethod
    def of(cls, found: Enclosing) -> EllipsoidFit:
        """Return the fit of an enclosing ellipsoid."""
        return cls(TaskEllipsoid.from_axes(found.axes, found.center), found.inside, found.gap, found.flat)

    @property
    def share(self) -> float:
        """Share of the wrenches inside the ellipsoid."""
        return float(np.mean(self.inside))

    def __str__(self) -> str:
        volume = "" if self.gap is None else f", volume within {self.gap:.2g} of the least around those it keeps"
        return f"{self.share:.2%} of {len(self.inside)} wrenches inside{volume}"


def fit_ellipsoid(
    wrenches: ArrayLike,
    *,
    outliers: float = 0.0,
    probability: float | None = None,
    center: ArrayLike | None = None,
    gap: float = GAP,
) -> EllipsoidFit:
    """Return the minimum-volume ellipsoid around wrenches, or their covariance ellipsoid.

    Parameters
    ----------
    wrenches : (m, d) array
        Wrenches that the fingers are to exert, newtons and newton-metres, d = 3 (planar) or 6.
    outliers : float
        Share of the wrenches, below 0.5, that may be left outside: the farthest are trimmed iteratively until the
        choice is stable (a local optimum).
    probability : float, optional
        Instead, take the wrenches as normally distributed, and return the covariance ellipsoid that contains this
        share of them.
    center : (d,) array, optional
        Fixed centre, in the same units: zeros for a symmetric task.
    gap : float
        Certified relative excess of volume, the stopping tolerance.

    Raises
    ------
    InputError
        On shapes that do not match, wrenches that are not finite (the rows are named), or all equal.

    Warns
    -----
    UserWarning
        When the wrenches are constant along some directions: the ellipsoid is flat, and the directions are named.
    """
    return EllipsoidFit.of(enclose(wrenches, outliers, probability, center, gap))
