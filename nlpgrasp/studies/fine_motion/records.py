"""Records of fine manipulation: pick-up grasp, goal grasp and the finger moves between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import at_least
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution


@dataclass(frozen=True)
class FingerMove:
    """Move of one finger to its new contact while the others hold the body.

    Parameters
    ----------
    finger : int
        Index of the finger that moves.
    path : (m, space) array
        Points of the body's surface from the old contact to the new one, metres, body frame.
    slides : bool
        Whether the finger slides under pressure (without friction), or is lifted.
    held : Bounds
        Quality for the holding task meanwhile. For a lifted finger: certified quality of the other fingers, constant
        along the path. For a sliding finger: the least certified quality of all fingers at ``stations`` points of its
        path; the least along the path may be smaller, as nothing is certified between them.
    motion : FingerPath or None
        The hand's motion, or its obstruction; None without a hand of known limits.
    stations : int
        Number of certified grasps: 1 for a lifted finger.
    others : Bounds or None
        Certified quality of the other fingers alone, a lower bound on the whole path, as a sliding finger may exert no
        force. None means ``held`` for a lifted finger, and zero for a slide.
    """

    finger: int
    path: FloatArray
    slides: bool
    held: Bounds
    motion: FingerPath | None = None
    stations: int = 1
    others: Bounds | None = None

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(np.sum(np.linalg.norm(np.diff(self.path, axis=0), axis=1)))

    @property
    def feasible(self) -> bool:
        """Whether no known limit of the hand prevents the move."""
        return self.motion is None or self.motion.feasible

    @property
    def least(self) -> float:
        """Certified quality on the whole path: the lower bound of the other fingers alone."""
        if not self.slides:
            return self.held.lower
        return 0.0 if self.others is None else self.others.lower

    @property
    def certified(self) -> bool:
        """Whether a quality above zero is certified everywhere on the path."""
        return self.least > 0.0

    @property
    def held_text(self) -> str:
        """Quality during the move as text, with its certified part."""
        if not self.slides:
            return f"held with {self.held}" if self.certified else "not held by the other fingers"
        if self.held.upper <= 0.0:
            return "not held at one of its stations"
        stations = f"held with {self.held} at {self.stations} station{'' if self.stations == 1 else 's'}"
        if self.certified:
            return f"{stations}, and with at least {at_least(self.least)} between them, by the other fingers alone"
        return f"{stations}, not certified between them"

    def to_dict(self) -> Json:
        """Return the move as JSON data."""
        return {
            "finger": self.finger,
            "path": self.path.tolist(),
            "slides": self.slides,
            "held": self.held.to_dict(),
            "stations": self.stations,
            "certified": self.certified,
            "least": self.least,
            "motion": None if self.motion is None else self.motion.to_dict(),
        }


@dataclass(frozen=True)
class FineManipulation:
    """Pick-up grasp, goal grasp, and the finger moves from one to the other.

    Parameters
    ----------
    pick, goal : GraspSolution
        The goal's contacts are in the order of the fingers that take them.
    order : tuple of int
        Contact of ``goal.grasp`` that each finger takes.
    moves : tuple of FingerMove
        Moves in order; empty where either grasp is missing. If the hand's limits allow no order, those with the best
        holding quality, with the reasons.
    """

    pick: GraspSolution
    goal: GraspSolution
    order: tuple[int, ...] = ()
    moves: tuple[FingerMove, ...] = ()

    @property
    def success(self) -> bool:
        """Whether both grasps exist, every move is feasible, and each is certified on its whole path."""
        return self.held_at_stations and all(m.certified for m in self.moves)

    @property
    def held_at_stations(self) -> bool:
        """Whether the same holds at all examined stations; slides may be uncertified between them."""
        return bool(self.moves) and self.feasible and all(m.held.lower > 0.0 for m in self.moves)

    @property
    def feasible(self) -> bool:
        """Whether no known limit of the hand prevents any of the moves."""
        return all(m.feasible for m in self.moves)

    @property
    def outcome(self) -> str:
        """The result in a sentence."""
        if not self.moves:
            return "no moves: one of the two grasps was not found"
        if not self.feasible:
            return "the hand cannot make all of these moves"
        if not self.held_at_stations:
            return "the body is not held during every move"
        if self.success:
            return "the body is held during every move, certified along the whole path"
        *first, last = [str(m.finger) for m in self.moves if not m.certified]
        slides = f"fingers {', '.join(first)} and {last} slide" if first else f"finger {last} slides"
        return f"the body is held at all stations examined, but it is not certified between the stations where {slides}"

    def __str__(self) -> str:
        lines = [f"pick up: {self.pick.mu}", f"in the hand: {self.goal.mu}"]
        for move in self.moves:
            way = "slides" if move.slides else "is lifted and goes"
            lines.append(f"finger {move.finger} {way} {1e3 * move.length:.0f} mm; meanwhile {move.held_text}")
            if move.motion is not None:
                lines.append(f"  {move.motion}")
        return "\n".join([*lines, self.outcome])
