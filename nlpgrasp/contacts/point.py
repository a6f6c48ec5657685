"""Point contact without friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import Blocks
from nlpgrasp.contacts.cones.range_cone import RangeContact


@dataclass(frozen=True)
class PointContact(RangeContact):
    """Point contact without friction: one component, ``f_n >= 0`` (finger I of Example 2-2)."""

    kind: ClassVar[str] = "point"

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the normal force."""
        return (0,)

    def blocks(self, components: int) -> Blocks:
        """Return none."""
        return ()

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return unit normal force alone."""
        return np.ones((1, 1))

    def variables(self, space: int) -> int:
        """Return 1: the normal force."""
        return 1

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return ``(1,)``."""
        return np.ones(1)

    def split(self, x: Any, normal: Any) -> tuple[Any, Any]:
        """Return ``x n`` and no moment."""
        return x[0] * normal, None

    def normal_force(self, x: Any, normal: Any) -> Any:
        """Return ``x``."""
        return x[0]

    def membership(self, x: Any, normal: Any) -> list[tuple[str, Any]]:
        """Return ``f_n >= 0``."""
        return [("unilateral", x[0])]

    def squared_support(self, normal: Any, tangential: Any, torsion: Any, ops: Any) -> Any | None:
        """Return ``max(z_n, 0)^2``."""
        return ops.fmax(normal, 0.0) ** 2

    def linear_support(self, normal: Any, tangential: Any, torsion: Any, ops: Any) -> Any | None:
        """Return ``z_n``."""
        return normal

    def to_dict(self) -> dict[str, Any]:
        """Return ``{"model": "point"}``."""
        return {"model": self.kind}

    @classmethod
    def from_dict(cls, data: Json) -> PointContact:
        """Return the model that ``to_dict`` wrote."""
        return cls()
