"""L2 budget: unit ball of all finger forces, ``B_1^n`` of (2.5-2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.sets.l2 import L2Set
from nlpgrasp.common.rows import Row
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work


class L2Budget(ForceBudget):
    """L2 budget ``|x| <= 1`` on all force components; moments count in newton-metres."""

    kind: ClassVar[str] = "l2"
    amount: ClassVar[str] = "L2 norm of all finger forces"
    bounds_fingers: ClassVar[bool] = True
    largest: ClassVar[float] = 1.1

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> L2Set:
        """Return the force set for given contact frames."""
        return L2Set(contacts, frames.shape[1])

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops
    ) -> tuple[Expression, int] | None:
        """Return ``phi^2``, the sum of ``|P_Ki(z_i)|^2`` over the contacts."""
        squares = [c.squared_support(w, ops) for c, w in zip(contacts, work, strict=True)]
        return None if any(s is None for s in squares) else (sum(squares), 2)

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[Row]:
        """Return the constraint ``|x|^2 <= 1``."""
        sizes = [c.squared_size(x, n) for c, x, n in zip(contacts, forces, normals, strict=True)]
        return [Row("force budget", sum(sizes), upper=1.0)]
