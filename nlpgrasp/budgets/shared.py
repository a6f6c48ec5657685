"""The fingers share one unit of normal force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.budgets.base import ForceBudget, Row, extremes, ranges
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel


class SharedBudget(ForceBudget):
    """``sum f_n <= 1``: the convex hull of the contacts' wrenches.

    The L1 metric of Ferrari and Canny (1992, doi:10.1109/ROBOT.1992.219918).
    """

    kind: ClassVar[str] = "shared"
    limited: ClassVar[str] = "limits on normal force"
    power: ClassVar[float] = 8.0

    def support(self, z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
        """Return the largest of the contacts' ``max(0, z_n + mu |z_t|)``; that contact presses alone."""
        values, forces = extremes(z, contacts, space)
        best = np.argmax(values, axis=1)
        chosen = np.zeros_like(forces)
        for i, where in enumerate(ranges(contacts, space)):
            chosen[best == i, where] = forces[best == i, where]
        return values[np.arange(len(z)), best], chosen

    def used(self, x: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
        """Return the sum of the normal forces."""
        return np.asarray(np.sum(np.stack([x[:, r.start] for r in ranges(contacts, space)]), axis=0))

    def cones(self, contacts: Sequence[ContactModel], space: int) -> list[FloatArray]:
        """Return ``f - sum f_n >= 0``."""
        where = ranges(contacts, space)
        unit = np.eye(where[-1].stop + 1)
        return [unit[-1:] - unit[[r.start for r in where]].sum(axis=0, keepdims=True)]

    def pieces(
        self, contacts: Sequence[ContactModel], work: Sequence[tuple[Any, Any, Any]], ops: Any
    ) -> list[Any] | None:
        """Return the contacts' ``z_n + mu |z_t|``."""
        parts = [c.linear_support(*w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(p is None for p in parts) else parts

    def rows(self, contacts: Sequence[ContactModel], forces: Sequence[Any], normals: Sequence[Any]) -> list[Row]:
        """Return ``sum f_n <= 1``."""
        total = sum(c.normal_force(x, n) for c, x, n in zip(contacts, forces, normals, strict=True))
        return [("force budget", total, -np.inf, 1.0)]
