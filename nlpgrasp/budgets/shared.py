"""Shared budget: limit 1 of the sum of normal forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.base import ForceBudget, ForceSet
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.product import contact_supports


class SharedSet(ForceSet):
    """Force set ``{x in K : sum f_n <= 1}``."""

    power: ClassVar[float] = 8.0

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support, the largest of the contacts' supports at unit normal force, (m,), and maximisers (m, n).

        Only that contact exerts a force.
        """
        values, forces = contact_supports(z, self.contacts, self.space)
        best = np.argmax(values, axis=1)
        result = np.zeros_like(forces)
        for i, block in enumerate(self.ranges):
            result[best == i, block] = forces[best == i, block]
        return values[np.arange(len(z)), best], result

    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the sum of normal forces of each force vector (m, n), (m,)."""
        return np.asarray(np.sum(np.stack([x[:, r.start] for r in self.ranges]), axis=0))

    def cones(self) -> list[FloatArray]:
        """Return the condition ``f - sum f_n >= 0``, (1, n + 1)."""
        unit = np.eye(self.size + 1)
        return [unit[-1:] - unit[[r.start for r in self.ranges]].sum(axis=0, keepdims=True)]


class SharedBudget(ForceBudget):
    """Limit ``sum f_n <= 1`` of the total normal force: convex hull of the contact wrenches.

    The L1 metric of Ferrari and Canny (1992, doi:10.1109/ROBOT.1992.219918).
    """

    kind: ClassVar[str] = "shared"
    amount: ClassVar[str] = "sum of the normal forces"
    limited: ClassVar[str] = "limits on normal force"

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> SharedSet:
        """Return the force set for given contact frames."""
        return SharedSet(contacts, frames.shape[1])

    def pieces(self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops) -> list[Expression] | None:
        """Return each contact's largest work with unit normal force (symbolic), or ``None`` without a closed form.

        The support function is the maximum of these.
        """
        parts = [c.linear_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(p is None for p in parts) else parts

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the constraint ``sum f_n <= 1``."""
        total = sum(c.normal_force(x, n) for c, x, n in zip(contacts, forces, normals, strict=True))
        return [ScalarConstraint("force budget", total, upper=1.0)]
