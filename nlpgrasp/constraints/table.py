"""A table under the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from nlpgrasp.common.rows import Placement, Row
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.constraints.base import PlacementConstraint

THIN_FINGER = 5e-4  # metres


@dataclass(frozen=True)
class Table(PlacementConstraint):
    """Every fingertip stays above a horizontal table.

    Parameters
    ----------
    height : float
        Height of the table top along the last axis (z, or y for planar bodies), metres, body frame.
    clearance : float
        Least distance between the table and a fingertip's lowest point, metres, at least zero. By default that of a
        thin finger, half a millimetre: no contact lies on a face that stands on the table, where no finger gets between
        the two. With 0 a point finger may, as in the paper's own examples.
    """

    kind: ClassVar[str] = "table"
    height: float
    clearance: float = THIN_FINGER

    def __post_init__(self) -> None:
        object.__setattr__(self, "height", number("Table.height", self.height))
        object.__setattr__(self, "clearance", number("Table.clearance", self.clearance, at_least=0.0))

    def rows(self, placement: Placement) -> list[Row]:
        """Return one row for each fingertip: ``tip_z - radius >= height + clearance``."""
        lower = self.height + self.clearance
        return [
            Row("table", tip[-1] - radius, lower, scale=placement.size, unit="m", fingers=(i,))
            for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True))
        ] + [
            Row("table", s.centre[-1] - s.radius, lower, scale=placement.size, unit="m", link=s.link)
            for s in placement.links
        ]

    def to_dict(self) -> Json:
        """Return height and clearance."""
        return {"type": self.kind, "height": self.height, "clearance": self.clearance}
