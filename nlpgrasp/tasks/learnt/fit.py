"""Task ellipsoids from recorded wrenches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.enclosing import GAP, Enclosing, enclose


@dataclass(frozen=True)
class EllipsoidFit:
    """An ellipsoid fitted to wrenches.

    Parameters
    ----------
    task : TaskEllipsoid
        The ellipsoid fitted.
    inside : (m,) bool array
        Which wrenches are in it.
    gap : float or None
        Certified relative excess of its volume over the least around the wrenches it was fitted to; ``None`` for
        a covariance.
    flat : (s, d) array
        Unit directions, each component over its own extent, in which the wrenches do not differ.
    """

    task: TaskEllipsoid
    inside: NDArray[np.bool_]
    gap: float | None
    flat: FloatArray

    @classmethod
    def of(cls, found: Enclosing) -> EllipsoidFit:
        """Return the fit that an ellipsoid around wrenches is."""
        return cls(TaskEllipsoid.from_axes(found.axes, found.center), found.inside, found.gap, found.flat)

    @property
    def share(self) -> float:
        """Share of the wrenches that are inside."""
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
    """Return the ellipsoid of least volume around wrenches, or that of a probability.

    Parameters
    ----------
    wrenches : (m, d) array
        That the fingers are to exert, newtons and newton-metres, d = 3 (planar) or 6.
    outliers : float
        Share of the wrenches, below 0.5, that may be left outside: those farthest from the others, left out and
        chosen again until nothing changes (a local choice).
    probability : float, optional
        Instead, take the wrenches as normally distributed: the ellipsoid of their covariance that holds this share
        of such wrenches.
    center : (d,) array, optional
        Where the centre has to be, in the same units: zeros for a task that is the same either way.
    gap : float
        Certified relative excess of volume at which to stop.

    Raises
    ------
    InputError
        On shapes that do not match, wrenches that are not finite (the rows are named), or that are all the same.

    Warns
    -----
    UserWarning
        When the wrenches do not differ in some directions: the ellipsoid is flat, and the directions are named.
    """
    return EllipsoidFit.of(enclose(wrenches, outliers, probability, center, gap))
