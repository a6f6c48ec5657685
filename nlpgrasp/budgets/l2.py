"""L2 budget: limit 1 of the norm of all finger forces together, ``B_1^n`` of (2.5-2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.budgets.base import ForceBudget, ForceSet
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.product import project, project_lifted


class L2Set(ForceSet):
    """L2 force set ``{x in K : |x| <= 1}``, ``B_1^n ∩ K`` of (2.5-2)."""

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``|P_K(z)|``, (m,), and the maximisers ``P_K(z) / |P_K(z)|``, (m, n) (Moreau)."""
        x = project(z, self.contacts, self.space)
        size = np.linalg.norm(x, axis=1)
        return size, x / np.where(size > 0.0, size, 1.0)[:, None]

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the norms of ``P_K(z)``, and the variables (m, l) of ``P_K(z)`` over its norm."""
        if not self.is_lifted:
            return self.support(z)
        u = project_lifted(z, self.contacts, self.space)
        size = np.linalg.norm(u @ self.lift.T, axis=1)
        return size, u / np.where(size > 0.0, size, 1.0)[:, None]

    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the norms ``|x|``, (m,), of forces (m, n)."""
        return np.asarray(np.linalg.norm(x, axis=1))

    def cones(self) -> list[FloatArray]:
        """Return the cone ``|x| <= f``, (n + 1, n + 1)."""
        return [np.roll(np.eye(self.size + 1), 1, axis=0)]


class L2Budget(ForceBudget):
    """L2 budget ``|x| <= 1`` on all force components; moments count in newton-metres."""

    kind: ClassVar[str] = "l2"
    amount: ClassVar[str] = "L2 norm of all finger forces"
    bounds_fingers: ClassVar[bool] = True
    largest: ClassVar[float] = 1.1

    @property
    def has_kinks(self) -> bool:
        """False: the support is a root of a sum of squares."""
        return False

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
    ) -> list[ScalarConstraint]:
        """Return the constraint ``|x|^2 <= 1``."""
        sizes = [c.squared_size(x, n) for c, x, n in zip(contacts, forces, normals, strict=True)]
        return [ScalarConstraint("force budget", sum(sizes), upper=1.0)]
