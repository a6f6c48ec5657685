"""Per-finger budget: limit 1 of each normal force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from nlpgrasp.budgets.base import SMOOTH, ForceBudget, ForceSet
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.product import contact_supports, planar_edges


class PerFingerSet(ForceSet):
    """Force set ``{x in K : f_n <= 1 for every contact}``."""

    power: ClassVar[float] = 1.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the sum of the contacts' supports at unit normal force, (m,), and maximisers (m, n).

        Each contact exerts unit normal force or none.
        """
        values, forces = contact_supports(z, self.contacts, self.space)
        return np.sum(values, axis=1), forces

    @property
    def edges(self) -> FloatArray | None:
        """Edges of the set in the plane: those of each contact's friction cone, and lines between two of them."""
        edges = planar_edges(self.contacts) if self.space == 2 else None
        if edges is None:
            return None
        return np.asarray(block_diag(*[np.concatenate([own, own[1:] - own[:1]]) for own in edges]))

    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the largest normal force of each force vector (m, n), (m,)."""
        return np.asarray(np.max(np.stack([x[:, r.start] for r in self.ranges]), axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the conditions ``f - f_n >= 0`` of all contacts, (1, n + 1) each."""
        unit = np.eye(self.size + 1)
        return [unit[-1:] - unit[r.start : r.start + 1] for r in self.ranges]


class PerFingerBudget(ForceBudget):
    """Limit ``f_n <= 1`` of each normal force: Minkowski sum of contact wrenches (Ferrari and Canny's L-infinity)."""

    kind: ClassVar[str] = "per_finger"
    amount: ClassVar[str] = "largest normal force"
    limited: ClassVar[str] = "limits on normal force"

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> PerFingerSet:
        """Return the force set for given contact frames."""
        return PerFingerSet(contacts, frames.shape[1])

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops
    ) -> tuple[Expression, int] | None:
        """Return the sum of the contacts' supports at unit normal force, smoothed at their kinks."""
        parts: list[Expression] = [c.linear_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(p is None for p in parts) else (sum(0.5 * (p + ops.sqrt(p**2 + SMOOTH)) for p in parts), 1)

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the constraints ``f_n <= 1`` of all contacts."""
        return [
            ScalarConstraint("force budget", c.normal_force(x, n), upper=1.0, fingers=(i,))
            for i, (c, x, n) in enumerate(zip(contacts, forces, normals, strict=True))
        ]
