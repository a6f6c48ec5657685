"""What became of a grasp that was pressed through its hand's joints."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.shown.numbers import percent
from nlpgrasp.common.types import Json
from nlpgrasp.simulation.hand.motion import LOOSE, STRICT, Motion
from nlpgrasp.simulation.hand.world import Seen

AS_SOLVED, CONTROL = "as solved", "control: no squeeze"


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


@dataclass(frozen=True)
class HandSimulation:
    """A grasp pressed through its own hand's joints.

    Parameters
    ----------
    name : str
        The solution's.
    mass : float
        Of the object, kilograms.
    push : float
        Newtons.
    normal_force : float
        What each finger was to press with at least, newtons.
    trials : tuple of HandTrial
        One for each condition and push, in order.
    grasp : Seen
        Where everything is in the grasp.
    """

    name: str
    mass: float
    push: float
    normal_force: float
    trials: tuple[HandTrial, ...]
    grasp: Seen

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions that were tried, in order."""
        return tuple(dict.fromkeys(t.condition for t in self.trials))

    def of(self, condition: str) -> tuple[HandTrial, ...]:
        """Return the trials under a condition."""
        return tuple(t for t in self.trials if t.condition == condition)

    def share(self, condition: str) -> float:
        """Return the share of a condition's trials that were held strictly."""
        tried = self.of(condition)
        return sum(t.strict for t in tried) / len(tried)

    @property
    def squeezed(self) -> Motion:
        """How far the squeeze moved the object, as solved."""
        return self.of(AS_SOLVED)[0].squeezed

    @property
    def held(self) -> bool:
        """Whether the grasp as solved held everything strictly."""
        return all(t.strict for t in self.of(AS_SOLVED))

    @property
    def control_lost(self) -> bool:
        """Whether the same without a squeeze lost the object: what holds it is the squeeze."""
        return not all(t.strict for t in self.of(CONTROL))

    @property
    def confirmed(self) -> bool:
        """Whether the grasp as solved held everything, and the control did not."""
        return self.held and self.control_lost

    @property
    def verdict(self) -> str:
        """The verdict in a sentence."""
        if not self.held:
            lost = next(t for t in self.of(AS_SOLVED) if not t.strict)
            return f"NOT confirmed: lost at {lost.label} ({lost.whole})"
        if not self.control_lost:
            return "NOT confirmed: held without a squeeze as well, so that nothing is said about the squeeze"
        return "confirmed: held as solved, lost without the squeeze"

    def to_dict(self) -> Json:
        """Return the simulation as JSON data: metres and radians."""
        trials = [
            {
                "condition": t.condition,
                "trial": t.label,
                "squeezed": {"slip": t.squeezed.slip, "turn": t.squeezed.turn},
                "slip": t.motion.slip,
                "turn": t.motion.turn,
                "strict": t.strict,
                "loose": t.loose,
            }
            for t in self.trials
        ]
        return {
            "name": self.name,
            "confirmed": self.confirmed,
            "verdict": self.verdict,
            "mass": self.mass,
            "push": self.push,
            "normal_force": self.normal_force,
            "trials": trials,
        }

    def __str__(self) -> str:
        pressed = f"fingers press with {self.normal_force:g} N"
        lines = [f"{self.name}: pushes of {self.push:g} N, {self.mass:.3g} kg, {pressed}"]
        for condition in self.conditions:
            tried = self.of(condition)
            strict, loose = sum(t.strict for t in tried), sum(t.loose for t in tried)
            closed, worst = (
                Motion.largest(found) for found in zip(*((t.squeezed, t.motion) for t in tried), strict=True)
            )
            held = f"strict {strict} of {len(tried)} ({percent(strict / len(tried))}), loose {loose}"
            by = "" if condition == CONTROL else f"the squeeze moves it by {closed}, then "
            lines.append(f"  {condition:28} {held}; {by}at most {worst}")
        return "\n".join(lines)
