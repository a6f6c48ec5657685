"""How a finger gets to its new contact: sliding along the surface, or lifted off, over it, and set down."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.studies.fine_motion.paths.footpath import Footpath

SLIDING, OFF, OVER, DOWN = "sliding", "lifting off", "lifted", "setting down"


@dataclass(frozen=True)
class Foothold:
    """Where the fingertip's contact is to be.

    Parameters
    ----------
    point, normal : (space,) array
        Metres, body frame, and inward unit normal; a lifted fingertip's point is as high above the surface.
    along : float
        Metres of the path over the surface up to here.
    phase : {"sliding", "lifting off", "lifted", "setting down"}
    height : float
        Metres above the surface.
    """

    point: FloatArray
    normal: FloatArray
    along: float
    phase: str
    height: float = 0.0


@dataclass(frozen=True)
class Stride:
    """The whole way of a finger to its new contact.

    Parameters
    ----------
    footpath : Footpath
    lift : float
        Metres that the fingertip is above the surface on its way; 0 where it slides.
    """

    footpath: Footpath
    lift: float

    @property
    def total(self) -> float:
        """The whole way, metres: lifting and setting down included."""
        return self.footpath.total + 2.0 * self.lift

    @property
    def turns(self) -> tuple[float, ...]:
        """Where phases begin and end: places of the way that are waypoints."""
        ends = (self.lift, self.lift + self.footpath.total) if self.lift else ()
        return (*ends, self.total)

    def at(self, way: float) -> Foothold:
        """Return the foothold after so much of the way, metres."""
        over = self.footpath.total
        point, normal, along = self.footpath.at(min(max(way - self.lift, 0.0), over))
        if not self.lift:
            return Foothold(point, normal, along, SLIDING)
        height = max(min(way, self.lift, self.total - way), 0.0)
        phase = OFF if way < self.lift else DOWN if way > self.lift + over else OVER
        return Foothold(point - height * normal, normal, along, phase, height)
