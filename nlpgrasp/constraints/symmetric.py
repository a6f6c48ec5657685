"""Mirror symmetry of two contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, number, replace_unchecked
from nlpgrasp.constraints.base import PlacementConstraint, is_unit
from nlpgrasp.constraints.workspace import check_fingers, finger_numbers
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Symmetric(PlacementConstraint):
    """Mirror symmetry of two contacts about a plane, within a tolerance.

    Parameters
    ----------
    fingers : (int, int)
        The two contacts.
    normal : (space,) array
        Of the mirror plane, body frame; normalised.
    offset : float
        ``normal . p`` on the plane, for a unit normal, metres.
    tolerance : float
        Largest distance along each axis from the mirror image, metres, greater than zero. On a symmetric body exact
        equality would be redundant with the surface constraint.
    """

    kind: ClassVar[str] = "symmetric"
    fingers: Sequence[int]
    normal: ArrayLike
    offset: float = 0.0
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        fingers = finger_numbers("Symmetric.fingers", self.fingers)
        if len(fingers) != 2:
            raise InputError("Symmetric.fingers", self.fingers, "two fingers")
        object.__setattr__(self, "fingers", fingers)
        normal = array("Symmetric.normal", self.normal, (None,))
        size = float(np.linalg.norm(normal))
        if size == 0.0:
            raise InputError("Symmetric.normal", self.normal, "a direction")
        object.__setattr__(self, "normal", tuple((normal / size).tolist()))
        object.__setattr__(self, "offset", number("Symmetric.offset", self.offset))
        object.__setattr__(self, "tolerance", number("Symmetric.tolerance", self.tolerance, above=0.0))

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise for a plane of another dimension than the body's, or for invalid finger indices."""
        if np.size(self.normal) != space:
            raise InputError("Symmetric.normal", f"{np.size(self.normal)} numbers", f"{space} numbers")
        check_fingers("Symmetric.fingers", self.fingers, contacts)

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return one scalar constraint per coordinate: mirror image less the other contact, within the tolerance."""
        a, b = (placement.positions[i] for i in self.fingers)
        n = ca.DM(np.asarray(self.normal))
        difference = a - 2.0 * (ca.dot(n, a) - self.offset) * n - b
        fingers, tolerance = tuple(self.fingers), self.tolerance
        return [
            ScalarConstraint(
                "symmetric", difference[c], -tolerance, tolerance, placement.size, "m", fingers=fingers, part=axis
            )
            for c, axis in zip(range(difference.shape[0]), "xyz", strict=False)
        ]

    def to_dict(self) -> Json:
        """Return fingers, plane and tolerance as JSON data."""
        return {
            "type": self.kind,
            "fingers": list(self.fingers),
            "normal": list(np.asarray(self.normal, float)),
            "offset": self.offset,
            "tolerance": self.tolerance,
        }

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint from its JSON data, without rescaling a unit normal."""
        result, normal = super().from_dict(data), data["normal"]
        return replace_unchecked(result, normal=tuple(normal)) if is_unit(normal) else result
