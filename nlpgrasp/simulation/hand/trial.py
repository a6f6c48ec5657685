"""One attempt to take an object out of a hand."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.simulation.hand.motion import LOOSE, STRICT, Motion
from nlpgrasp.simulation.hand.world import Seen

AS_SOLVED, CONTROL, LIFTED = "as solved", "control: no squeeze", "lifted 20 cm"


@dataclass(frozen=True)
class HandTrial:
    """One attempt to take the object out of the hand: a push, or lifting it.

    Parameters
    ----------
    condition : str
    label : str
        What was done.
    squeezed : Motion
        How far the squeeze itself had moved the object.
    motion : Motion
        The farthest that the object got from where the squeeze had left it, palm frame.
    seen : tuple of Seen
        The run, 25 times a second.
    placed_off : bool
        Whether the object stood elsewhere than in the grasp as solved: the squeeze then has to move it.
    """

    condition: str
    label: str
    squeezed: Motion
    motion: Motion
    seen: tuple[Seen, ...] = ()
    placed_off: bool = False

    @property
    def is_lift(self) -> bool:
        """Whether the object was lifted under gravity; otherwise it was pushed, without gravity."""
        return self.label == LIFTED

    @property
    def whole(self) -> Motion:
        """How far the object moved, at most: by the squeeze and after it; of one that was placed off, after it."""
        return self.motion if self.placed_off else self.squeezed + self.motion

    @property
    def strict(self) -> bool:
        """Whether the object moved at most 1 cm and 10 degrees."""
        return self.whole.within(STRICT)

    @property
    def loose(self) -> bool:
        """Whether the object moved at most 5 cm and 15 degrees."""
        return self.whole.within(LOOSE)
