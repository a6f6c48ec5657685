"""The forces of at most one unit of normal force a finger."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import extremes


class PerFingerSet(ForceSet):
    """``{x in K : f_n <= 1 for every contact}``."""

    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the sum of the contacts' ``max(0, z_n + mu |z_t|)``, (m, n) to (m,), and the forces, (m, n).

        Each contact presses fully or not at all.
        """
        values, forces = extremes(z, self.contacts, self.space)
        return np.sum(values, axis=1), forces

    def used(self, x: FloatArray) -> FloatArray:
        """Return the largest normal force, (m, n) to (m,)."""
        return np.asarray(np.max(np.stack([x[:, r.start] for r in self.ranges]), axis=0))

    def cones(self) -> list[FloatArray]:
        """Return ``f - f_n >= 0`` for every contact, (1, n + 1) each."""
        unit = np.eye(self.size + 1)
        return [unit[-1:] - unit[r.start : r.start + 1] for r in self.ranges]
