"""Force set of the per-finger budget."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import extremes


class PerFingerSet(ForceSet):
    """Force set ``{x in K : f_n <= 1 for every contact}``."""

    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the sum of the contacts' ``max(0, z_n + mu |z_t|)``, (m,), and maximisers (m, n).

        Each contact exerts unit normal force or none.
        """
        values, forces = extremes(z, self.contacts, self.space)
        return np.sum(values, axis=1), forces

    def used(self, x: FloatArray) -> FloatArray:
        """Return the largest normal forces (m,) of forces (m, n)."""
        return np.asarray(np.max(np.stack([x[:, r.start] for r in self.ranges]), axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the conditions ``f - f_n >= 0`` of all contacts, (1, n + 1) each."""
        unit = np.eye(self.size + 1)
        return [unit[-1:] - unit[r.start : r.start + 1] for r in self.ranges]
