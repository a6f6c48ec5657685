"""Shared budget: limit 1 of the sum of normal forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from nlpgrasp.budgets.base import ForceBudget, ForceSet
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import contact_supports, planar_edges


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

    @property
    def edges(self) -> FloatArray | None:
        """Edges of the set in the plane: lines from each corner, 0 or an edge of a friction cone, to all others."""
        edges = planar_edges(self.contacts) if self.space == 2 else None
        if edges is None:
            return None
        corners = np.concatenate([np.zeros((1, self.size)), block_diag(*edges)])
        first, second = np.triu_indices(len(corners), 1)
        return np.asarray(corners[second] - corners[first])

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

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the constraint ``sum f_n <= 1``."""
        total = sum(c.normal_force(x, n) for c, x, n in zip(contacts, forces, normals, strict=True))
        return [ScalarConstraint("force budget", total, upper=1.0)]
