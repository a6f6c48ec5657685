"""Force set of the per-finger size budget."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import project


class PerFingerSizeSet(ForceSet):
    """Force set ``{x in K : |x_i| <= 1 for every contact i}``."""

    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the sum of the contacts' ``|P_Ki(z_i)|``, (m,), and maximisers (m, n)."""
        x = project(z, self.contacts, self.space)
        total = np.zeros(len(z))
        for where in self.ranges:
            size = np.linalg.norm(x[:, where], axis=1)
            total += size
            x[:, where] /= np.where(size > 0.0, size, 1.0)[:, None]
        return total, x

    def used(self, x: FloatArray) -> FloatArray:
        """Return the largest finger forces (m,) of forces (m, n)."""
        return np.asarray(np.max([np.linalg.norm(x[:, r], axis=1) for r in self.ranges], axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the cones ``|x_i| <= f`` of all contacts, (n_i + 1, n + 1) each."""
        unit = np.eye(self.size + 1)
        return [np.concatenate([unit[-1:], unit[r]]) for r in self.ranges]
