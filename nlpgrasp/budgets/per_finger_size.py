"""Every finger may exert one unit of force, tangential force and torsion included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.budgets.base import SMOOTH, ForceBudget, Row, project, ranges
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel


class PerFingerSizeBudget(ForceBudget):
    """``|x_i| <= 1`` for every contact i: its gauge is the largest finger force (Lobo et al. 1998)."""

    kind: ClassVar[str] = "per_finger_size"
    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
        """Return the sum of the contacts' ``|P_Ki(z_i)|``."""
        x = project(z, contacts, space)
        total = np.zeros(len(z))
        for where in ranges(contacts, space):
            size = np.linalg.norm(x[:, where], axis=1)
            total += size
            x[:, where] /= np.where(size > 0.0, size, 1.0)[:, None]
        return total, x

    def used(self, x: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
        """Return the largest finger force."""
        return np.asarray(np.max([np.linalg.norm(x[:, r], axis=1) for r in ranges(contacts, space)], axis=0))

    def cones(self, contacts: Sequence[ContactModel], space: int) -> list[FloatArray]:
        """Return ``|x_i| <= f`` for every contact."""
        where = ranges(contacts, space)
        unit = np.eye(where[-1].stop + 1)
        return [np.concatenate([unit[-1:], unit[r]]) for r in where]

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[tuple[Any, Any, Any]], ops: Any
    ) -> tuple[Any, int] | None:
        """Return the sum of the contacts' ``|P_Ki(z_i)|``, rounded where one is 0."""
        squares: list[Any] = [c.squared_support(*w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(s is None for s in squares) else (sum(ops.sqrt(s + SMOOTH) for s in squares), 1)

    def rows(self, contacts: Sequence[ContactModel], forces: Sequence[Any], normals: Sequence[Any]) -> list[Row]:
        """Return ``|x_i|^2 <= 1`` for every contact."""
        return [(f"force budget, finger {i}", x.T @ x, -np.inf, 1.0) for i, x in enumerate(forces)]
