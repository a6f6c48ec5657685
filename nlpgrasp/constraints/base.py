"""What every constraint states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from nlpgrasp.common.rows import Clearance, Placement, Row
from nlpgrasp.common.types import Json


class PlacementConstraint(ABC):
    """A condition on where the contacts may be ((3.5-15), (3.5-16))."""

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

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the constraint as JSON data."""
