"""Per-finger size budget: limit 1 of the norm of each finger force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.base import SMOOTH, ForceBudget, ForceSet
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.product import project, project_lifted


class PerFingerSizeSet(ForceSet):
    """Force set ``{x in K : |x_i| <= 1 for every contact i}``."""

    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the sum of the contacts' ``|P_Ki(z_i)|``, (m,), and maximisers (m, n)."""
        x = project(z, self.contacts, self.space)
        total = np.zeros(len(z))
        for block in self.ranges:
            size = np.linalg.norm(x[:, block], axis=1)
            total += size
            x[:, block] /= np.where(size > 0.0, size, 1.0)[:, None]
        return total, x

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support (m,), and the variables (m, l) of each contact's ``P_Ki(z_i)`` over its norm."""
        if not self.is_lifted:
            return self.support(z)
        u = project_lifted(z, self.contacts, self.space)
        x, total = u @ self.lift.T, np.zeros(len(z))
        for block in self.ranges:
            size, own = np.linalg.norm(x[:, block], axis=1), np.any(self.lift[block] != 0.0, axis=0)
            total += size
            u[:, own] /= np.where(size > 0.0, size, 1.0)[:, None]
        return total, u

    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the largest finger force of each force vector (m, n), (m,)."""
        return np.asarray(np.max([np.linalg.norm(x[:, r], axis=1) for r in self.ranges], axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the cones ``|x_i| <= f`` of all contacts, (n_i + 1, n + 1) each."""
        unit = np.eye(self.size + 1)
        return [np.concatenate([unit[-1:], unit[r]]) for r in self.ranges]


class PerFingerSizeBudget(ForceBudget):
    """Limit ``|x_i| <= 1`` of each contact force; its gauge is the largest finger force (Lobo et al. 1998)."""

    kind: ClassVar[str] = "per_finger_size"
    amount: ClassVar[str] = "largest finger force"
    bounds_fingers: ClassVar[bool] = True

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> PerFingerSizeSet:
        """Return the force set for given contact frames."""
        return PerFingerSizeSet(contacts, frames.shape[1])

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops
    ) -> tuple[Expression, int] | None:
        """Return the sum of ``|P_Ki(z_i)|`` over the contacts, smoothed at its kinks."""
        squares: list[Expression] = [c.squared_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(s is None for s in squares) else (sum(ops.sqrt(s + SMOOTH) for s in squares), 1)

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the constraints ``|x_i|^2 <= 1`` of all contacts."""
        return [
            ScalarConstraint("force budget", c.squared_size(x, n), upper=1.0, fingers=(i,))
            for i, (c, x, n) in enumerate(zip(contacts, forces, normals, strict=True))
        ]
