"""One simulated trial: a push on the held object, or a lift."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.simulation.hand.motion import LOOSE, STRICT, Motion
from nlpgrasp.simulation.hand.world import Seen

AS_SOLVED, CONTROL, LIFTED = "as solved", "control: no squeeze", "lifted 20 cm"


@dataclass(frozen=True)
class HandTrial:
    """One trial to take the object out of the hand: a push or a lift.

    Parameters
    ----------
    condition : str
    label : str
        Description of the push or lift.
    squeezed : Motion
        Motion of the object by the squeeze itself.
    motion : Motion
        Largest motion of the object after the squeeze, palm frame.
    seen : tuple of Seen
        States of the run, 25 per second.
    placed_off : bool
        Whether the object began displaced from the grasp as solved, so that the squeeze has to move it.
    """

    condition: str
    label: str
    squeezed: Motion
    motion: Motion
    seen: tuple[Seen, ...] = ()
    placed_off: bool = False

    @property
    def is_lift(self) -> bool:
        """Whether the object was lifted under gravity, not pushed without gravity."""
        return self.label == LIFTED

    @property
    def whole(self) -> Motion:
        """Largest motion of the object by the squeeze and after it; after it alone for a displaced object."""
        return self.motion if self.placed_off else self.squeezed + self.motion

    @property
    def strict(self) -> bool:
        """Whether the object moved at most 1 cm and 10 degrees."""
        return self.whole.within(STRICT)

    @property
    def loose(self) -> bool:
        """Whether the object moved at most 5 cm and 15 degrees."""
        return self.whole.within(LOOSE)
