"""Outcome of a simulation with free fingertips: trials, comparison with the certified bounds, report text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.simulation.fingertip_model import MAX_SLIP, MAX_TURN, Snapshot

LOWER_TOLERANCE = 0.08  # tolerance below the lower bound: simulated friction creeps at its limit
UPPER_TOLERANCE = 0.05  # tolerance above the upper bound: motion takes time to show


@dataclass(frozen=True)
class Trial:
    """Simulation of one task wrench under one condition.

    Parameters
    ----------
    condition : str
    label : str
        The wrench, as text.
    snapshots : tuple of Snapshot
        States of the run.
    """

    condition: str
    label: str
    snapshots: tuple[Snapshot, ...]

    @property
    def slip(self) -> float:
        """Largest distance of a contact point from its fingertip over the run, metres."""
        return max(s.slip for s in self.snapshots)

    @property
    def turn(self) -> float:
        """Largest rotation of the body over the run, radians."""
        return max(s.turn for s in self.snapshots)

    @property
    def held(self) -> bool:
        """Whether slip and rotation stayed within the limits."""
        return not any(s.lost for s in self.snapshots)


@dataclass(frozen=True)
class Simulation:
    """Result of simulating a solution in MuJoCo with free fingertips.

    Parameters
    ----------
    name : str
        The solution's.
    share : float
        Scale of the task wrenches, as a share of certified mu.
    effort : float
        Effort of the hand, units of the force budget.
    mass : float
        Kilograms.
    trials : tuple of Trial
        One for each condition and wrench.
    gap : float
        The certified upper bound over the lower one.
    lost_at : float or None
        Share of the certified lower bound at which the growing hardest wrench was lost.
    growing : Trial
        The run with the growing wrench.
    notes : tuple of str
        Conditions that could not be simulated, with reasons.
    touching : str
        Links that penetrate something and contacts off their links, as text; empty without any.
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
        """The simulated conditions, in order."""
        return tuple(dict.fromkeys(t.condition for t in self.trials))

    def of(self, condition: str) -> tuple[Trial, ...]:
        """Return the trials under a given condition."""
        return tuple(t for t in self.trials if t.condition == condition)

    @property
    def held(self) -> bool:
        """Whether the grasp as solved held every wrench, with gravity and without."""
        return all(t.held for t in self.trials if t.condition in self.conditions[:2])

    @property
    def confirmed(self) -> bool:
        """Whether the simulation confirms the certified bounds.

        The task wrenches were held, and the growing wrench was lost within or near the bounds. Near means between 0.92
        of the lower bound and 1.05 of the upper one; ``verdict`` says where.
        """
        return (
            self.held
            and self.lost_at is not None
            and 1.0 - LOWER_TOLERANCE <= self.lost_at <= self.gap * (1.0 + UPPER_TOLERANCE)
        )

    @property
    def verdict(self) -> str:
        """Comparison with the certified bounds, as a sentence."""
        if not self.held:
            return "NOT confirmed: lost a wrench that the certificate says can be held"
        if self.lost_at is None or self.lost_at > self.gap * (1.0 + UPPER_TOLERANCE):
            return "NOT confirmed: held more than the certificate says is possible"
        if self.lost_at >= 1.0:
            return "confirmed: the grasp as solved holds what is certified, and loses what is more"
        scale = f"{np.floor(1e3 * self.lost_at) / 1e3:.3f} of the certified share"
        creep = f"simulated friction creeps: {1.0 - LOWER_TOLERANCE:g} is enough"
        if self.confirmed:
            return f"confirmed to {scale}: there the grasp as solved loses the hardest wrench ({creep})"
        return f"NOT confirmed: loses the hardest wrench at {scale} ({creep})"

    def __str__(self) -> str:
        summary = f"{self.name}: wrenches up to {self.share:g} of certified mu, effort {self.effort:.4g}"
        lines = [f"{self.name}: {self.touching}"] if self.touching else []
        lines.append(f"{summary}, mass {self.mass:.3g} kg")
        lines += [describe_trials(condition, self.of(condition)) for condition in self.conditions]
        lost = "never lost" if self.lost_at is None else f"lost at {self.lost_at:.3f}"
        lines.append(f"  hardest wrench, growing  {lost}; certified in [1, {self.gap:.3f}] of the lower bound")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])


def describe_trials(condition: str, trials: Sequence[Trial]) -> str:
    """Return the outcome of a condition's trials as one line of text."""
    count = sum(t.held for t in trials)
    worst = max(trials, key=lambda t: max(t.slip / MAX_SLIP, t.turn / MAX_TURN))
    verdict = "held" if count == len(trials) else "LOST" if not count else "PARTLY LOST"
    motion = f"at most {1e3 * worst.slip:.2g} mm and {np.degrees(worst.turn):.2g} degrees"
    location = "" if worst.held else f", at {worst.label}"
    return f"  {condition:24} {verdict}, {count} of {len(trials)} wrenches, {motion}{location}"
