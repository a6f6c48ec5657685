"""What a simulation found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.simulation.snapshot import MOST_SLIP, MOST_TURN, Snapshot

EARLY = 0.08  # of the lower bound: simulated friction creeps where it is at its limit
LATE = 0.05  # of the upper bound: the body has to be seen moving


@dataclass(frozen=True)
class Trial:
    """One task wrench under one condition.

    Parameters
    ----------
    condition : str
    label : str
        The wrench, in words.
    snapshots : tuple of Snapshot
        The run.
    """

    condition: str
    label: str
    snapshots: tuple[Snapshot, ...]

    @property
    def slip(self) -> float:
        """Largest way of a point of contact from its fingertip, metres."""
        return max(s.slip for s in self.snapshots)

    @property
    def turn(self) -> float:
        """How far the body turned, radians."""
        return max(s.turn for s in self.snapshots)

    @property
    def held(self) -> bool:
        """Whether slip and turn stayed small."""
        return not any(s.lost for s in self.snapshots)


@dataclass(frozen=True)
class Simulation:
    """A solution in MuJoCo.

    Parameters
    ----------
    name : str
        The solution's.
    share : float
        Of certified mu, that the task wrenches were scaled by.
    effort : float
        Of the hand: units of the force budget.
    mass : float
        Kilograms.
    trials : tuple of Trial
        One for each condition and wrench.
    gap : float
        The certified upper bound over the lower one.
    lost_at : float or None
        Of the certified lower bound, the share of the hardest wrench at which the grasp was lost as it grew.
    growing : Trial
        The run in which it grew.
    notes : tuple of str
        What could not be tried, and why.
    touching : str
        Links that are inside something and contacts off their links, in words; empty where there are none.
    """

    name: str
    share: float
    effort: float
    mass: float
    trials: tuple[Trial, ...]
    gap: float
    lost_at: float | None
    growing: Trial
    notes: tuple[str, ...] = ()
    touching: str = ""

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions that were tried, in order."""
        return tuple(dict.fromkeys(t.condition for t in self.trials))

    def of(self, condition: str) -> tuple[Trial, ...]:
        """Return the trials under a condition."""
        return tuple(t for t in self.trials if t.condition == condition)

    @property
    def held(self) -> bool:
        """Whether the grasp as solved held every wrench, with and without gravity."""
        return all(t.held for t in self.trials if t.condition in self.conditions[:2])

    @property
    def confirmed(self) -> bool:
        """Whether both ends were seen: held at the share, and lost within or just beside the certified bounds.

        Just beside: at no less than 0.92 of the lower one and no more than 1.05 of the upper; ``verdict`` says where.
        """
        return self.held and self.lost_at is not None and 1.0 - EARLY <= self.lost_at <= self.gap * (1.0 + LATE)

    @property
    def verdict(self) -> str:
        """The verdict in a sentence: up to which share of the certified bound the hardest wrench was held."""
        if not self.held:
            return "NOT confirmed: lost a wrench that the certificate says can be held"
        if self.lost_at is None or self.lost_at > self.gap * (1.0 + LATE):
            return "NOT confirmed: held more than the certificate says is possible"
        if self.lost_at >= 1.0:
            return "confirmed: the grasp as solved holds what is certified, and loses what is more"
        share = f"{np.floor(1e3 * self.lost_at) / 1e3:.3f} of the certified share"
        least = f"simulated friction creeps: {1.0 - EARLY:g} is enough"
        if self.confirmed:
            return f"confirmed to {share}: there the grasp as solved loses the hardest wrench ({least})"
        return f"NOT confirmed: loses the hardest wrench at {share} ({least})"

    def __str__(self) -> str:
        first = f"{self.name}: wrenches up to {self.share:g} of certified mu, effort {self.effort:.4g}"
        lines = [f"{self.name}: {self.touching}"] if self.touching else []
        lines.append(f"{first}, mass {self.mass:.3g} kg")
        lines += [in_words(condition, self.of(condition)) for condition in self.conditions]
        lost = "never lost" if self.lost_at is None else f"lost at {self.lost_at:.3f}"
        lines.append(f"  hardest wrench, growing  {lost}; certified in [1, {self.gap:.3f}] of the lower bound")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])


def in_words(condition: str, trials: Sequence[Trial]) -> str:
    """Return in a line what became of a condition's trials."""
    count = sum(t.held for t in trials)
    worst = max(trials, key=lambda t: max(t.slip / MOST_SLIP, t.turn / MOST_TURN))
    verdict = "held" if count == len(trials) else "LOST" if not count else "PARTLY LOST"
    seen = f"at most {1e3 * worst.slip:.2g} mm and {np.degrees(worst.turn):.2g} degrees"
    where = "" if worst.held else f", at {worst.label}"
    return f"  {condition:24} {verdict}, {count} of {len(trials)} wrenches, {seen}{where}"
