"""Outcome of a simulation with the hand's joints."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.types import Json
from nlpgrasp.simulation.hand.motion import Motion
from nlpgrasp.simulation.hand.table import legend, pressing, row
from nlpgrasp.simulation.hand.trial import AS_SOLVED, CONTROL, HandTrial
from nlpgrasp.simulation.hand.world import Seen


@dataclass(frozen=True)
class HandSimulation:
    """Result of simulating a grasp by its own hand's joints.

    Parameters
    ----------
    name : str
        The solution's.
    mass : float
        Of the object, kilograms.
    push : float
        Newtons.
    normal_force : float
        Requested least normal force of each finger, newtons.
    trials : tuple of HandTrial
        One for each condition and push, in order.
    grasp : Seen
        State in the grasp.
    mass_source : str
        Source of the object's mass, as text.
    normal_forces : tuple of float
        Normal force of each finger in the squeeze, newtons.
    touching : str
        Links that penetrate something and contacts off their links, as text; empty without any.
    """

    name: str
    mass: float
    push: float
    normal_force: float
    trials: tuple[HandTrial, ...]
    grasp: Seen
    mass_source: str = ""
    normal_forces: tuple[float, ...] = ()
    touching: str = ""

    @property
    def conditions(self) -> tuple[str, ...]:
        """The simulated conditions, in order."""
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
        """Motion of the object by the squeeze, as solved."""
        return self.of(AS_SOLVED)[0].squeezed

    @property
    def held(self) -> bool:
        """Whether the grasp as solved held everything strictly."""
        return all(t.strict for t in self.of(AS_SOLVED))

    @property
    def control_lost(self) -> bool:
        """Whether the control without a squeeze lost the object, so that the squeeze holds it."""
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
            moved = "" if lost.whole.gone else f" ({lost.whole})"
            return f"NOT confirmed: lost {'when' if lost.is_lift else 'at'} {lost.label}{moved}"
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
            "mass_source": self.mass_source,
            "push": self.push,
            "normal_force": self.normal_force,
            "normal_forces": list(self.normal_forces),
            "touching": self.touching,
            "trials": trials,
        }

    def __str__(self) -> str:
        source = f", {self.mass_source}" if self.mass_source else ""
        pressed = pressing(self.normal_force, self.normal_forces)
        lines = [f"{self.name}: {self.touching}"] if self.touching else []
        lines += [f"{self.name}: {self.mass:.3g} kg{source}; {pressed}", *legend(self.trials, self.push)]
        return "\n".join([*lines, *(row(self.of(condition)) for condition in self.conditions)])
