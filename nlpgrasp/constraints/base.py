"""Base class of constraints on contacts and hand."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.registry import JsonPart
from nlpgrasp.common.scalar_constraints import Clearance, ScalarConstraint, SymbolicCandidate

ROUNDING = 4.0 * float(np.finfo(float).eps)  # tolerance of a unit vector's length


class PlacementConstraint(JsonPart):
    """A constraint on contacts and hand, (3.5-15) or (3.5-16).

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    """

    @abstractmethod
    def rows(self, placement: SymbolicCandidate) -> Sequence[ScalarConstraint | Clearance]:
        """Return the scalar constraints that this constraint adds to the NLP."""

    def forbidden_faces(self) -> tuple[str, ...]:
        """Return the names of the faces on which this constraint allows no contact."""
        return ()

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise if the constraint is invalid for a body's dimension and size, or for the number of contacts."""
        del space, size, contacts

    def least_distance(self) -> float:
        """Return the least distance, metres, that the constraint enforces between any two contacts; 0 if none."""
        return 0.0


def is_unit(vector: Sequence[float]) -> bool:
    """Return whether a vector has unit length up to rounding.

    Normalising it again might change a digit.
    """
    return bool(abs(float(np.linalg.norm(vector)) - 1.0) <= ROUNDING)
