"""Force set of the shared budget."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import extremes


class SharedSet(ForceSet):
    """Force set ``{x in K : sum f_n <= 1}``."""

    power: ClassVar[float] = 8.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the largest of the contacts' ``max(0, z_n + mu |z_t|)``, (m,), and maximisers (m, n).

        Only that contact exerts a force.
        """
        values, forces = extremes(z, self.contacts, self.space)
        best = np.argmax(values, axis=1)
        chosen = np.zeros_like(forces)
        for i, where in enumerate(self.ranges):
            chosen[best == i, where] = forces[best == i, where]
        return values[np.arange(len(z)), best], chosen

    def used(self, x: FloatArray) -> FloatArray:
        """Return the sums of normal forces (m,) of forces (m, n)."""
        return np.asarray(np.sum(np.stack([x[:, r.start] for r in self.ranges]), axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the condition ``f - sum f_n >= 0``, (1, n + 1)."""
        unit = np.eye(self.size + 1)
        return [unit[-1:] - unit[[r.start for r in self.ranges]].sum(axis=0, keepdims=True)]
