"""Approach cone: constraint on the palm's approach direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import angle, array, replace_unchecked
from nlpgrasp.constraints.base import PlacementConstraint, is_unit
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Approach(PlacementConstraint):
    """Approach cone: limits the angle between the palm's approach direction and a given direction.

    Parallel jaws are free to turn about the closing line c between their contacts: some approach across it is within
    the angle of d if ``(c . d)^2 <= sin(angle)^2 |c|^2``, and always if the angle is at least a right angle.

    Parameters
    ----------
    direction : (3,) array
        Of the palm, body frame: (0, 0, -1) for an approach from above.
    angle : float
        Half the cone's opening angle, radians, greater than zero and at most pi.
    """

    kind: ClassVar[str] = "approach"
    direction: ArrayLike
    angle: float

    def __post_init__(self) -> None:
        direction = array("Approach.direction", self.direction, (3,))
        size = float(np.linalg.norm(direction))
        if size == 0.0:
            raise InputError("Approach.direction", self.direction, "a direction")
        object.__setattr__(self, "direction", tuple((direction / size).tolist()))
        object.__setattr__(self, "angle", angle("Approach.angle", self.angle, np.pi, "pi"))

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise for planar bodies, which have no palm."""
        if space != 3:
            raise InputError("Approach.direction", "a planar body", "a body in space")

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return ``a . d >= cos(angle)`` for the palm's direction a, or the constraint on the closing line of jaws."""
        if placement.palm is None and placement.closing is not None:
            return self._jaw_constraint(placement.closing, placement.size)
        if placement.palm is None:
            raise InputError("Approach", "no palm", "a hand with a palm, such as ng.URDFHand, or ng.ParallelJaw")
        cosine = ca.dot(placement.palm.approach, ca.DM(np.asarray(self.direction)))
        return [ScalarConstraint("approach", cosine, float(np.cos(self.angle)), unit="cos", link="palm")]

    def _jaw_constraint(self, closing: Expression, size: float) -> list[ScalarConstraint]:
        """Return the constraint that some approach perpendicular to the closing line is within the cone."""
        if self.angle >= np.pi / 2.0:
            return []
        component = ca.dot(closing, ca.DM(np.asarray(self.direction)))
        excess = component**2 - float(np.sin(self.angle)) ** 2 * ca.sumsqr(closing)
        return [ScalarConstraint("approach", excess, upper=0.0, scale=size**2, unit="m2", link="palm")]

    def to_dict(self) -> Json:
        """Return direction and angle as JSON data."""
        return {"type": self.kind, "direction": list(np.asarray(self.direction, float)), "angle": self.angle}

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint from its JSON data, without rescaling a unit direction."""
        result, direction = super().from_dict(data), data["direction"]
        return replace_unchecked(result, direction=tuple(direction)) if is_unit(direction) else result
