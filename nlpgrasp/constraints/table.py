"""A table under the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from nlpgrasp.common.rows import Placement, Row
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.errors import InputError

THIN_FINGER = 5e-4  # metres


class Bounded(Protocol):
    """What is in a box, tight or not: a body."""

    tight: ClassVar[bool]

    @property
    def bounds(self) -> FloatArray:
        """Lower and upper corner, (2, space), metres."""


@dataclass(frozen=True)
class Table(PlacementConstraint):
    """Every fingertip, and every other link of a hand, stays above a horizontal table.

    Parameters
    ----------
    height : float
        Height of the table top along the last axis (z, or y for planar bodies), metres, body frame.
    clearance : float
        Least distance between the table and the lowest point of a fingertip or link, metres, at least zero. By default
        that of a thin finger, half a millimetre: no contact lies on a face that stands on the table, where no finger
        gets between the two. With 0 a point finger may, as in the paper's own examples.
    """

    kind: ClassVar[str] = "table"
    height: float
    clearance: float = THIN_FINGER

    def __post_init__(self) -> None:
        object.__setattr__(self, "height", number("Table.height", self.height))
        object.__setattr__(self, "clearance", number("Table.clearance", self.clearance, at_least=0.0))

    @classmethod
    def under(cls, body: Bounded, clearance: float = THIN_FINGER) -> Table:
        """Return the table that a body stands on: its height is that of the body's lowest point.

        Parameters
        ----------
        body : Body
            As it stands: the last axis of its frame points up.
        clearance : float
            Metres, at least zero.

        Raises
        ------
        InputError
            On an implicit surface, of which only a box around it is known.
        """
        if not body.tight:
            raise InputError("Table.under", "an implicit surface", "another body; of this ng.Table(height)")
        return cls(float(np.asarray(body.bounds)[0, -1]), clearance)

    def rows(self, placement: Placement) -> list[Row]:
        """Return a row for each fingertip, ``tip_z - radius >= height + clearance``, and for each link's sphere."""
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
