"""A grasp to pick up with, a better one, and the moves between them: plain, frozen data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
        Certified quality against the holding task meanwhile, the least along the path: of the other fingers, and
        of the sliding one.
    motion : FingerPath or None
        How the hand does it, or why it does not; None without a hand whose limits are known.
    """

    finger: int
    path: FloatArray
    slides: bool
    held: Bounds
    motion: FingerPath | None = None

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(np.sum(np.linalg.norm(np.diff(self.path, axis=0), axis=1)))

    @property
    def feasible(self) -> bool:
        """Whether nothing that is known of the hand is against the move."""
        return self.motion is None or self.motion.feasible

    def to_dict(self) -> Json:
        """Return the move as JSON data."""
        return {
            "finger": self.finger,
            "path": self.path.tolist(),
            "slides": self.slides,
            "held": self.held.to_dict(),
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
        """Whether both grasps exist, every move is held by a force-closed grasp, and none is beyond the hand."""
        return bool(self.moves) and self.feasible and all(m.held.lower > 0.0 for m in self.moves)

    @property
    def feasible(self) -> bool:
        """Whether nothing that is known of the hand is against any of the moves."""
        return all(m.feasible for m in self.moves)

    def __str__(self) -> str:
        lines = [f"pick up: {self.pick.mu}", f"in the hand: {self.goal.mu}"]
        for move in self.moves:
            way = "slides" if move.slides else "is lifted and goes"
            lines.append(f"finger {move.finger} {way} {1e3 * move.length:.0f} mm; meanwhile held with {move.held}")
            if move.motion is not None:
                lines.append(f"  {move.motion}")
        return "\n".join(lines)
