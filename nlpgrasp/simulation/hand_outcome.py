"""Outcome of a simulation with the hand's joints: trials, verdict, report text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.types import Json
from nlpgrasp.simulation.hand_world import LOOSE, STRICT, HandSnapshot, Motion

AS_SOLVED, CONTROL, LIFTED = "as solved", "control: no squeeze", "lifted"
PRESSING_TOLERANCE = 0.1  # relative difference from the squeeze's normal forces up to which fingers press as stated


@dataclass(frozen=True)
class HandTrial:
    """One trial that tries to take the object out of the hand: a wrench of the task or a lift.

    Parameters
    ----------
    condition : str
    label : str
        Description of the wrench or lift.
    squeezed : Motion
        Motion of the object by the squeeze itself.
    motion : Motion
        Largest motion of the object after the squeeze, palm frame.
    seen : tuple of HandSnapshot
        States of the run, 25 per second.
    placed_off : bool
        Whether the object began displaced from the grasp as solved, so that the squeeze has to move it.
    """

    condition: str
    label: str
    squeezed: Motion
    motion: Motion
    seen: tuple[HandSnapshot, ...] = ()
    placed_off: bool = False

    @property
    def is_lift(self) -> bool:
        """Whether the trial is a lift under gravity; otherwise it is a wrench without gravity."""
        return self.label.startswith(LIFTED)

    @property
    def whole(self) -> Motion:
        """Largest motion of the object since the grasp, the squeeze included.

        For an object placed off its position, the squeeze is excluded.
        """
        return self.motion if self.placed_off else self.squeezed + self.motion

    @property
    def strict(self) -> bool:
        """Whether the object moved by at most 1 cm and 10 degrees."""
        return self.whole.within(STRICT)

    @property
    def loose(self) -> bool:
        """Whether the object moved by at most 5 cm and 15 degrees."""
        return self.whole.within(LOOSE)


def condition_name(condition: str) -> str:
    """Return the printed name of a condition."""
    return condition.replace(": ", ", ")


def format_outcome(trials: Sequence[HandTrial]) -> str:
    """Return how many trials of a condition were held, as text.

    For the control, how many were lost.

    Parameters
    ----------
    trials : sequence of HandTrial
        All of one condition, at least one.
    """
    count, strict, loose = len(trials), sum(t.strict for t in trials), sum(t.loose for t in trials)
    if trials[0].condition == CONTROL:
        expectation = "as it should be" if strict < count else "although it should be"
        return f"lost in {count - strict} of {count}, {expectation}"
    loads, lifts = [t for t in trials if not t.is_lift], [t for t in trials if t.is_lift]
    loaded = f"{sum(t.strict for t in loads)} of {len(loads)} wrenches"
    if not lifts:
        text = f"{loaded} held (no lift)"
    elif strict == count:
        text = f"{loaded} and the lift held"
    else:
        text = f"{loaded} held, the lift {'held' if all(t.strict for t in lifts) else 'lost'}"
    return text if loose == strict else f"{text}, loosely {loose} of {count}"


def format_row(trials: Sequence[HandTrial]) -> str:
    """Return a condition's row of the table: number of held trials, largest motion of the object."""
    condition = trials[0].condition
    squeezed, motion = Motion.largest(t.squeezed for t in trials), Motion.largest(t.motion for t in trials)
    text = f"  {condition_name(condition):28} {format_outcome(trials)}"
    if condition == CONTROL:
        return text if motion.gone else f"{text}; at most {motion}"
    if squeezed.gone:
        return f"{text}; the squeeze itself loses it"
    return f"{text}; the squeeze moves it by {squeezed}, then {'it is lost' if motion.gone else f'at most {motion}'}"


def trial_legend(trials: Sequence[HandTrial], share: float) -> list[str]:
    """Return lines of text that explain the trials and the motion limits.

    Parameters
    ----------
    trials : sequence of HandTrial
        Of all conditions.
    share : float
        Size of the wrenches, as a share of the task's.
    """
    solved = [t for t in trials if t.condition == AS_SOLVED]
    protocol = f"  wrenches of the task's boundary at {format_number(share, 3)} of its size, without gravity"
    if lifts := [t.label for t in solved if t.is_lift]:
        protocol += f"; as solved and in the control also {lifts[0]}, with gravity"
    limits = f"  held: moved in the hand by at most {_format_motion_limits(STRICT)}"
    is_loose_listed = any(t.loose != t.strict for t in trials if t.condition != CONTROL)
    return [protocol, f"{limits}; loosely: {_format_motion_limits(LOOSE)}" if is_loose_listed else limits]


def format_normal_forces(normal_force: float, forces: Sequence[float]) -> str:
    """Return the normal forces of the fingers as text: the requested least, and the range if they differ.

    Parameters
    ----------
    normal_force : float
        Requested least normal force of each finger, newtons.
    forces : sequence of float
        Normal force of each finger, newtons; may be empty.
    """
    text = f"each finger presses with at least {format_number(normal_force)} N"
    extremes = [format_number(end(forces)) for end in (min, max)] if forces else []
    return text if len(set(extremes)) < 2 else f"{text} ({extremes[0]} to {extremes[1]} N)"


def _format_motion_limits(limits: tuple[float, float]) -> str:
    """Return the motion limits as text, in centimetres and degrees."""
    return f"{100.0 * limits[0]:.0f} cm and {np.degrees(limits[1]):.0f} degrees"


@dataclass(frozen=True)
class HandSimulation:
    """Result of simulating a grasp with the joints of its hand.

    Parameters
    ----------
    name : str
        The solution's.
    mass : float
        Of the object, kilograms.
    share : float
        Size of the wrenches, as a share of the task's.
    normal_force : float
        Requested least normal force of each finger, newtons.
    trials : tuple of HandTrial
        One for each condition and wrench or lift, in order.
    grasp : HandSnapshot
        State in the grasp.
    mass_source : str
        Source of the object's mass, as text.
    normal_forces : tuple of float
        Normal force of each finger in the squeeze, newtons.
    touching : str
        Links that penetrate something and contacts off their links, as text; empty without any.
    asked : float
        The share of the task that was asked for: more than ``share`` where the squeeze presses with less than it needs.
    pressed : (2,) tuple
        Least and largest ratio, of all fingers, of the normal force in the simulation to that of the squeeze.
    """

    name: str
    mass: float
    share: float
    normal_force: float
    trials: tuple[HandTrial, ...]
    grasp: HandSnapshot
    mass_source: str = ""
    normal_forces: tuple[float, ...] = ()
    touching: str = ""
    asked: float = 0.0
    pressed: tuple[float, float] = (1.0, 1.0)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The simulated conditions, in order."""
        return tuple(dict.fromkeys(t.condition for t in self.trials))

    def of(self, condition: str) -> tuple[HandTrial, ...]:
        """Return the trials under a given condition."""
        return tuple(t for t in self.trials if t.condition == condition)

    def share_held(self, condition: str) -> float:
        """Return the fraction of a condition's trials that were held strictly."""
        trials = self.of(condition)
        return sum(t.strict for t in trials) / len(trials)

    @property
    def squeezed(self) -> Motion:
        """Motion of the object caused by the squeeze, for the grasp as solved."""
        return self.of(AS_SOLVED)[0].squeezed

    @property
    def held(self) -> bool:
        """Whether the grasp as solved held strictly in all trials."""
        return all(t.strict for t in self.of(AS_SOLVED))

    @property
    def control_lost(self) -> bool:
        """Whether the control, a hand that does not squeeze, lost the object in some trial."""
        return not all(t.strict for t in self.of(CONTROL))

    @property
    def confirmed(self) -> bool:
        """Whether the grasp as solved held in all trials, and the control did not."""
        return self.held and self.control_lost

    @property
    def verdict(self) -> str:
        """Verdict on the grasp as solved and on the control, as a sentence."""
        if not self.held:
            lost = next(t for t in self.of(AS_SOLVED) if not t.strict)
            motion = "" if lost.whole.gone else f" ({lost.whole})"
            return f"NOT confirmed: lost {'when' if lost.is_lift else 'at'} {lost.label}{motion}"
        if not self.control_lost:
            return "held, not confirmed: held without a squeeze as well, so that nothing is said about the squeeze"
        reach = (
            "" if self.share >= self.asked else f" to {format_number(self.share, 3)} of the task, not {self.asked:g}"
        )
        return f"confirmed{reach}: held as solved, lost without the squeeze"

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
            "share": self.share,
            "asked": self.asked,
            "normal_force": self.normal_force,
            "normal_forces": list(self.normal_forces),
            "pressed": list(self.pressed),
            "touching": self.touching,
            "trials": trials,
        }

    def __str__(self) -> str:
        source = f", {self.mass_source}" if self.mass_source else ""
        forces = format_normal_forces(self.normal_force, self.normal_forces)
        least, largest = self.pressed
        if least < 1.0 - PRESSING_TOLERANCE or largest > 1.0 + PRESSING_TOLERANCE:
            forces += f", in the simulation with {least:.2g} to {largest:.2g} of it"
        lines = [f"{self.name}: {self.touching}"] if self.touching else []
        lines += [f"{self.name}: {self.mass:.3g} kg{source}; {forces}", *trial_legend(self.trials, self.share)]
        return "\n".join([*lines, *(format_row(self.of(condition)) for condition in self.conditions)])
