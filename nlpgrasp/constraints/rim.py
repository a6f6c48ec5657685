"""Contacts at the rim of a plate, a cup or a bore: near a circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.workspace import check_fingers, finger_numbers
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Rim(PlacementConstraint):
    """Contacts are at most ``width`` from a circle.

    Parameters
    ----------
    centre : (3,) array
        Metres, body frame.
    axis : (3,) array
        Across its plane, of any length.
    radius, width : float
        Metres, greater than zero.
    fingers : sequence of int, optional
        Indices of contacts; by default all.
    """

    kind: ClassVar[str] = "rim"
    centre: Sequence[float]
    axis: Sequence[float]
    radius: float
    width: float
    fingers: Sequence[int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", tuple(array("Rim.centre", self.centre, (3,)).tolist()))
        object.__setattr__(self, "axis", tuple(array("Rim.axis", self.axis, (3,)).tolist()))
        if not any(self.axis):
            raise InputError("Rim.axis", list(self.axis), "a direction that is not zero")
        for name in ("radius", "width"):
            object.__setattr__(self, name, number(f"Rim.{name}", getattr(self, name), above=0.0))
        if self.fingers is not None:
            object.__setattr__(self, "fingers", finger_numbers("Rim.fingers", self.fingers))

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise for a planar body, a width beyond the body's size, or invalid finger indices."""
        check_fingers("Rim.fingers", self.fingers, contacts)
        if space == 2:
            raise InputError("Rim", "a planar body", "a body in space")
        if self.width > 2.0 * size:
            raise InputError("Rim.width", f"{self.width:g} m", f"at most the body's diagonal, {2.0 * size:.3g} m")

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return a scalar constraint per contact: a limit on the squared distance from the circle."""
        result, axis = [], ca.DM(self.axis) / float(np.linalg.norm(self.axis))
        for i, p in enumerate(placement.positions):
            if self.fingers is None or i in self.fingers:
                arm = p - ca.DM(self.centre)
                height = ca.dot(arm, axis)
                beyond = ca.sqrt(ca.sumsqr(arm - height * axis) + 1e-18) - self.radius
                square, limit = beyond**2 + height**2, self.width**2
                result.append(ScalarConstraint("rim", square, -np.inf, limit, placement.size**2, "m2", fingers=(i,)))
        return result

    def to_dict(self) -> Json:
        """Return circle, width and fingers as JSON data."""
        return {
            "type": self.kind,
            "centre": list(self.centre),
            "axis": list(self.axis),
            "radius": self.radius,
            "width": self.width,
            "fingers": None if self.fingers is None else list(self.fingers),
        }
