"""Clearance of fingertips and hand links above a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.errors import InputError

THIN_FINGER = 5e-4  # m, default clearance


class HasBounds(Protocol):
    """Protocol of bodies with a bounding box."""

    tight: ClassVar[bool]

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space): lower corner, upper corner, metres."""


@dataclass(frozen=True)
class Table(PlacementConstraint):
    """A horizontal table, above which fingertips and hand links stay.

    Parameters
    ----------
    height : float
        Height of the table top along the last axis (z, or y for planar bodies), metres, body frame.
    clearance : float
        Least distance between the table and the lowest point of a fingertip or link, metres, at least zero. The
        default, half a millimetre, is that of a thin finger, and excludes contacts on a face that stands on the table.
        0 allows them for point fingers, as in the paper's examples.
    """

    kind: ClassVar[str] = "table"
    height: float
    clearance: float = THIN_FINGER

    def __post_init__(self) -> None:
        object.__setattr__(self, "height", number("Table.height", self.height))
        object.__setattr__(self, "clearance", number("Table.clearance", self.clearance, at_least=0.0))

    @classmethod
    def under(cls, body: HasBounds, clearance: float = THIN_FINGER) -> Table:
        """Return a table at the height of a body's lowest point.

        Parameters
        ----------
        body : Body
            The last axis of its frame points up.
        clearance : float
            Metres, at least zero.

        Raises
        ------
        InputError
            For an implicit surface, of which only a bounding box is known.
        """
        if not body.tight:
            raise InputError("Table.under", "an implicit surface", "another body; of this ng.Table(height)")
        return cls(float(np.asarray(body.bounds)[0, -1]), clearance)

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return a constraint ``tip_z - radius >= height + clearance`` for each fingertip and each probe of a link.

        A program has no probes: its links keep the clearance by their collision shapes.
        """
        lower = self.height + self.clearance
        return [
            ScalarConstraint("table", tip[-1] - radius, lower, scale=placement.size, unit="m", fingers=(i,))
            for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True))
        ] + [
            ScalarConstraint("table", s.centre[-1] - s.radius, lower, scale=placement.size, unit="m", link=s.link)
            for s in placement.links
        ]

    def to_dict(self) -> Json:
        """Return height and clearance as JSON data."""
        return {"type": self.kind, "height": self.height, "clearance": self.clearance}
