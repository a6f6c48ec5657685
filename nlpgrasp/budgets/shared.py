"""Shared budget: unit limit on the sum of normal forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.sets.shared import SharedSet
from nlpgrasp.common.rows import Row
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work


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
        """Return ``z_n + mu |z_t|`` of all contacts, whose maximum is the support function."""
        parts = [c.linear_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(p is None for p in parts) else parts

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[Row]:
        """Return the constraint ``sum f_n <= 1``."""
        total = sum(c.normal_force(x, n) for c, x, n in zip(contacts, forces, normals, strict=True))
        return [Row("force budget", total, upper=1.0)]
