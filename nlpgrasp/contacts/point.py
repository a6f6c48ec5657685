"""Frictionless point contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import Blocks, Work
from nlpgrasp.contacts.cones import RangeContact


@dataclass(frozen=True)
class PointContact(RangeContact):
    """Frictionless point contact: one component, ``f_n >= 0`` (finger I of Example 2-2)."""

    kind: ClassVar[str] = "point"

    @property
    def coefficients(self) -> dict[str, float]:
        """Friction coefficients, of which there are none."""
        return {}

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the index of the only component, the normal force."""
        return (0,)

    def blocks(self, components: int) -> Blocks:
        """Return an empty tuple: the normal force is the only component."""
        return ()

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return the unit normal force alone, (1, 1)."""
        return np.ones((1, 1))

    def variables(self, space: int) -> int:
        """Return the number of NLP variables: 1, the normal force."""
        return 1

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variable of a unit force along the normal, (1,)."""
        return np.ones(1)

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return the force ``x n`` and no moment (symbolic, body frame)."""
        return x[0] * normal, None

    def normal_force(self, x: Expression, normal: Expression) -> Expression:
        """Return ``x``, which is the normal force."""
        return x[0]

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return the one expression ``f_n``, nonnegative in the force domain."""
        return [("unilateral", x[0])]

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return the closed form ``max(z_n, 0)^2`` (symbolic)."""
        return ops.fmax(work.normal, 0.0) ** 2

    def linear_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``z_n``, the work of unit normal force (symbolic)."""
        return work.normal

    def to_dict(self) -> Json:
        """Return the model's name as JSON data."""
        return {"model": self.kind}

    @classmethod
    def from_dict(cls, data: Json) -> PointContact:
        """Return the model from the data of its ``to_dict``."""
        return cls()
