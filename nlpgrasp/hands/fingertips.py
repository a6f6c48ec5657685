"""Hand of free spherical fingertips with a limited reach from a palm point."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.common.scalar_constraints import TIPS_APART, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import LARGEST_TIP, FloatArray, hand_length, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand, HandVariable


@dataclass(frozen=True)
class Fingertips(Hand):
    """A hand of free spherical fingertips, with limits on mutual distances and on the reach from a palm point.

    Parameters
    ----------
    count : int
        Number of fingertips.
    radius : float
        Of each fingertip, metres; 0 for points. Fingertips do not overlap.
    spread : float or (float, float), optional
        Greatest distance, or least and greatest, between any two fingertip centres, metres.
    reach : float, optional
        Every fingertip centre is at most this far from one palm point, metres. The palm point is a variable
        of the program: anywhere around the body, also inside it (an enveloping hand).
    """

    kind: ClassVar[str] = "fingertips"
    count: int
    radius: float = 0.0
    spread: float | Sequence[float] | None = None
    reach: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", integer("Fingertips.count", self.count, at_least=1))
        radius = hand_length("Fingertips.radius", number("Fingertips.radius", self.radius, at_least=0.0), LARGEST_TIP)
        object.__setattr__(self, "radius", radius)
        if self.spread is not None:
            spread = self.spread
            ends = tuple(spread) if isinstance(spread, Iterable) and np.ndim(spread) else (0.0, spread)
            if len(ends) != 2:
                raise InputError("Fingertips.spread", self.spread, "one distance, or a least and a greatest one")
            low = number("Fingertips.spread", ends[0], at_least=0.0)
            high = hand_length("Fingertips.spread", number("Fingertips.spread", ends[1], above=low))
            object.__setattr__(self, "spread", (low, high))
        if self.reach is not None:
            reach = hand_length("Fingertips.reach", number("Fingertips.reach", self.reach, above=0.0))
            object.__setattr__(self, "reach", reach)

    @property
    def tip_radii(self) -> tuple[float, ...]:
        """Radius of each fingertip, metres."""
        return (self.radius,) * self.count

    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return the palm point as a variable if a reach is given, else an empty list."""
        if self.reach is None:
            return []
        size = float(np.linalg.norm(bounds[1] - bounds[0]))
        margin = self.reach + self.radius
        return [HandVariable("palm", bounds[0] - margin, bounds[1] + margin, size / 2.0)]

    def start(self, tips: FloatArray) -> dict[str, FloatArray]:
        """Return the centroids of the fingertips (..., k, space) as palm points, metres, if a reach is given."""
        return {} if self.reach is None else {"palm": np.asarray(tips.mean(axis=-2))}

    def rows(self, placement: SymbolicCandidate, variables: dict[str, Expression]) -> list[ScalarConstraint]:
        """Return the constraints on reach, spread and overlap, as squared distances."""
        tips, size2 = placement.tips, placement.size**2
        rows = []
        if self.reach is not None:
            rows += [
                ScalarConstraint(
                    "reach",
                    ca.sumsqr(tip - variables["palm"]),
                    upper=self.reach**2,
                    scale=size2,
                    unit="m2",
                    fingers=(i,),
                )
                for i, tip in enumerate(tips)
            ]
        low, high = (0.0, np.inf) if self.spread is None else (float(v) for v in np.ravel(self.spread))
        low = max(low, 2.0 * self.radius)
        if low > 0.0 or np.isfinite(high):
            rows += [
                ScalarConstraint(TIPS_APART, ca.sumsqr(p - q), low**2, high**2, size2, "m2", fingers=(i, j))
                for (i, p), (j, q) in combinations(enumerate(tips), 2)
            ]
        return rows

    def to_dict(self) -> Json:
        """Return the limits as JSON data."""
        spread = None if self.spread is None else [float(v) for v in np.ravel(self.spread)]
        return {
            "type": self.kind,
            "count": self.count,
            "radius": self.radius,
            "spread": spread,
            "reach": self.reach,
        }
