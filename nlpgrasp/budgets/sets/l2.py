"""Force set of the L2 budget."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import project


class L2Set(ForceSet):
    """L2 force set ``{x in K : |x| <= 1}``, ``B_1^n n K`` of (2.5-2)."""

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``|P_K(z)|``, (m,), and the maximisers ``P_K(z) / |P_K(z)|``, (m, n) (Moreau)."""
        x = project(z, self.contacts, self.space)
        size = np.linalg.norm(x, axis=1)
        return size, x / np.where(size > 0.0, size, 1.0)[:, None]

    def used(self, x: FloatArray) -> FloatArray:
        """Return the norms ``|x|``, (m,), of forces (m, n)."""
        return np.asarray(np.linalg.norm(x, axis=1))

    def cones(self) -> list[FloatArray]:
        """Return the cone ``|x| <= f``, (n + 1, n + 1)."""
        return [np.roll(np.eye(self.size + 1), 1, axis=0)]
