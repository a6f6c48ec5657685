"""The fingers share one unit of normal force."""

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
    """``sum f_n <= 1``: the convex hull of the contacts' wrenches.

    The L1 metric of Ferrari and Canny (1992, doi:10.1109/ROBOT.1992.219918).
    """

    kind: ClassVar[str] = "shared"
    amount: ClassVar[str] = "sum of the normal forces"
    limited: ClassVar[str] = "limits on normal force"

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> SharedSet:
        """Return the forces that it allows contacts with these frames."""
        return SharedSet(contacts, frames.shape[1])

    def pieces(self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops) -> list[Expression] | None:
        """Return the contacts' ``z_n + mu |z_t|``."""
        parts = [c.linear_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(p is None for p in parts) else parts

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[Row]:
        """Return the one row ``sum f_n <= 1``."""
        total = sum(c.normal_force(x, n) for c, x, n in zip(contacts, forces, normals, strict=True))
        return [Row("force budget", total, upper=1.0)]
