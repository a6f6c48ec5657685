"""Distance limits between contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.workspace import check_fingers, finger_numbers
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Spread(PlacementConstraint):
    """Limits on all pairwise distances of contacts: at least ``min``, at most ``max``.

    Parameters
    ----------
    min : float
        Metres, at least zero.
    max : float, optional
        Metres, greater than ``min``; by default no limit.
    fingers : sequence of int, optional
        Indices of contacts; by default all.
    """

    kind: ClassVar[str] = "spread"
    min: float = 0.0
    max: float | None = None
    fingers: Sequence[int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "min", number("Spread.min", self.min, at_least=0.0))
        if self.max is not None:
            object.__setattr__(self, "max", number("Spread.max", self.max, above=self.min))
        if self.min == 0.0 and self.max is None:
            raise InputError("Spread", "neither min nor max", "a least or a greatest distance")
        if self.fingers is not None:
            object.__setattr__(self, "fingers", finger_numbers("Spread.fingers", self.fingers))
            if len(self.fingers) < 2:
                raise InputError("Spread.fingers", list(self.fingers), "two fingers at least")

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise for a least distance longer than the body or for invalid finger indices."""
        check_fingers("Spread.fingers", self.fingers, contacts)
        if contacts > 1 and self.min > 2.0 * size:
            raise InputError("Spread.min", f"{self.min:g} m", f"at most the body's diagonal, {2.0 * size:.3g} m")

    def least_distance(self) -> float:
        """Return ``min``, metres, if the constraint applies to all contacts, else 0."""
        return self.min if self.fingers is None else 0.0

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return one scalar constraint per pair of contacts: limits on the squared distance."""
        upper = np.inf if self.max is None else self.max**2
        return [
            ScalarConstraint("spread", ca.sumsqr(p - q), self.min**2, upper, placement.size**2, "m2", fingers=(i, j))
            for (i, p), (j, q) in combinations(enumerate(placement.positions), 2)
            if self.fingers is None or {i, j} <= set(self.fingers)
        ]

    def to_dict(self) -> Json:
        """Return limits and fingers as JSON data."""
        fingers = None if self.fingers is None else list(self.fingers)
        return {"type": self.kind, "min": self.min, "max": self.max, "fingers": fingers}
