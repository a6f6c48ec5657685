"""Records of fine manipulation: a grasp to pick up with, a better one, and the moves between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import at_least
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.fine_motion.finger_path import FingerPath


@dataclass(frozen=True)
class FingerMove:
    """One finger goes to its new place while the others hold the body.

    Parameters
    ----------
    finger : int
        Index of the finger that moves.
    path : (m, space) array
        Points of the body's surface from the old contact to the new one, metres, body frame.
    slides : bool
        Whether the finger keeps pressing on its way (without friction, as a sliding finger does), or is lifted.
    held : Bounds
        Quality against the holding task meanwhile. Of a lifted finger: certified quality of the other fingers, whose
        grasp is the same all along the path. Of a sliding finger: the least of the certified qualities, of all fingers,
        at ``stations`` places of its path; the least along the path may be less, as nothing is certified between them.
    motion : FingerPath or None
        How the hand does it, or why it does not; None without a hand whose limits are known.
    stations : int
        Number of grasps certified: 1 of a lifted finger.
    others : Bounds or None
        Certified quality of the other fingers alone. Everywhere on its path a sliding finger may press with nothing, so
        that the quality is nowhere less. None stands for ``held`` of a lifted finger, and for nothing of a slide.
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
        """Whether nothing that is known of the hand is against the move."""
        return self.motion is None or self.motion.feasible

    @property
    def least(self) -> float:
        """Quality that is certified everywhere on the path: the lower bound of the other fingers alone."""
        if not self.slides:
            return self.held.lower
        return 0.0 if self.others is None else self.others.lower

    @property
    def certified(self) -> bool:
        """Whether a quality above zero is certified everywhere on the path."""
        return self.least > 0.0

    @property
    def held_text(self) -> str:
        """The quality meanwhile in words, with what is certified along the path."""
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
    """A grasp to pick up with, a better one, and how the fingers get from one to the other.

    Parameters
    ----------
    pick, goal : GraspSolution
        The goal's contacts are in the order of the fingers that take them.
    order : tuple of int
        Contact of ``goal.grasp`` that each finger takes.
    moves : tuple of FingerMove
        One after another; empty where either grasp is missing. Where no order of moves is within the hand's limits,
        those that would be held best, with the reasons.
    """

    pick: GraspSolution
    goal: GraspSolution
    order: tuple[int, ...] = ()
    moves: tuple[FingerMove, ...] = ()

    @property
    def success(self) -> bool:
        """Whether both grasps exist, no move is beyond the hand, and each is certified to be held on its whole path."""
        return self.held_at_stations and all(m.certified for m in self.moves)

    @property
    def held_at_stations(self) -> bool:
        """Whether the same holds at all stations examined; slides may not be certified between them."""
        return bool(self.moves) and self.feasible and all(m.held.lower > 0.0 for m in self.moves)

    @property
    def feasible(self) -> bool:
        """Whether nothing that is known of the hand is against any of the moves."""
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
