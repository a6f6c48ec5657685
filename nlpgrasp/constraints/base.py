"""What every constraint states about itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.registry import StatedPart
from nlpgrasp.common.rows import Clearance, Placement, Row

ROUNDING = 4.0 * float(np.finfo(float).eps)


class PlacementConstraint(StatedPart):
    """A condition on where the contacts may be ((3.5-15), (3.5-16)).

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    """

    @abstractmethod
    def rows(self, placement: Placement) -> Sequence[Row | Clearance]:
        """Return the rows this constraint adds to the program."""

    def forbidden_faces(self) -> tuple[str, ...]:
        """Return names of faces that no contact may use."""
        return ()

    def check(self, space: int, size: float, contacts: int) -> None:
        """Refuse, naming the field, what can be seen to be wrong for this body and number of contacts."""
        del space, size, contacts

    def least_distance(self) -> float:
        """Return how far apart this constraint keeps any two contacts, metres."""
        return 0.0


def is_unit(vector: Sequence[float]) -> bool:
    """Return whether a vector of a file is of unit length to rounding: normalised again it might lose a digit."""
    return bool(abs(float(np.linalg.norm(vector)) - 1.0) <= ROUNDING)
