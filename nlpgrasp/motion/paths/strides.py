"""Full motion of a finger to its new contact: sliding, or lifted off, moved over the surface and set down."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.paths.footpath import Footpath

SLIDING, OFF, OVER, DOWN = "sliding", "lifting off", "lifted", "setting down"


@dataclass(frozen=True)
class Foothold:
    """Target contact of a fingertip on its path.

    Parameters
    ----------
    point, normal : (space,) array
        Metres, body frame, and inward unit normal; for a lifted fingertip, the point is above the surface.
    along : float
        Arc length on the surface up to here, metres.
    phase : {"sliding", "lifting off", "lifted", "setting down"}
    height : float
        Height above the surface, metres.
    """

    point: FloatArray
    normal: FloatArray
    along: float
    phase: str
    height: float = 0.0


@dataclass(frozen=True)
class Stride:
    """Full path of a finger to its new contact.

    Parameters
    ----------
    footpath : Footpath
    lift : float
        Height of the fingertip above the surface, metres; 0 for sliding.
    """

    footpath: Footpath
    lift: float

    @property
    def total(self) -> float:
        """Total path length, metres, lifting and setting down included."""
        return self.footpath.total + 2.0 * self.lift

    @property
    def turns(self) -> tuple[float, ...]:
        """Path lengths at which phases change, which are waypoints."""
        ends = (self.lift, self.lift + self.footpath.total) if self.lift else ()
        return (*ends, self.total)

    def at(self, way: float) -> Foothold:
        """Return the foothold at a path length, metres."""
        over = self.footpath.total
        point, normal, along = self.footpath.at(min(max(way - self.lift, 0.0), over))
        if not self.lift:
            return Foothold(point, normal, along, SLIDING)
        height = max(min(way, self.lift, self.total - way), 0.0)
        phase = OFF if way < self.lift else DOWN if way > self.lift + over else OVER
        return Foothold(point - height * normal, normal, along, phase, height)
