"""Text table of a simulation's outcome by condition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.simulation.hand.motion import LOOSE, STRICT, Motion
from nlpgrasp.simulation.hand.trial import CONTROL, HandTrial


def name_of(condition: str) -> str:
    """Return a condition's printed name, without the colon that follows it."""
    return condition.replace(": ", ", ")


def result(trials: Sequence[HandTrial]) -> str:
    """Return the number of held trials of a condition, or of lost ones of the control, as text.

    Parameters
    ----------
    trials : sequence of HandTrial
        All of one condition, at least one.
    """
    count, strict, loose = len(trials), sum(t.strict for t in trials), sum(t.loose for t in trials)
    if trials[0].condition == CONTROL:
        should = "as it should be" if strict < count else "although it should be"
        return f"lost in {count - strict} of {count}, {should}"
    pushes, lifts = [t for t in trials if not t.is_lift], [t for t in trials if t.is_lift]
    pushed = f"{sum(t.strict for t in pushes)} of {len(pushes)} pushes"
    if not lifts:
        told = f"{pushed} held (no lift)"
    elif strict == count:
        told = f"{pushed} and the lift held"
    else:
        told = f"{pushed} held, the lift {'held' if all(t.strict for t in lifts) else 'lost'}"
    return told if loose == strict else f"{told}, loosely {loose} of {count}"


def row(trials: Sequence[HandTrial]) -> str:
    """Return the table row of a condition: number of held trials, and largest motion of the object."""
    condition = trials[0].condition
    squeezed, after = Motion.largest(t.squeezed for t in trials), Motion.largest(t.motion for t in trials)
    told = f"  {name_of(condition):28} {result(trials)}"
    if condition == CONTROL:
        return told if after.gone else f"{told}; at most {after}"
    if squeezed.gone:
        return f"{told}; the squeeze itself loses it"
    return f"{told}; the squeeze moves it by {squeezed}, then {'it is lost' if after.gone else f'at most {after}'}"


def legend(trials: Sequence[HandTrial], push: float) -> list[str]:
    """Return what the trials do and what counts as held; loosely too if that number differs.

    Parameters
    ----------
    trials : sequence of HandTrial
        Of all conditions.
    push : float
        Newtons.
    """
    done = (
        f"  six pushes of {push:g} N without gravity; as solved and in the control also lifted by 20 cm, with gravity"
    )
    held = f"  held: moved in the hand by at most {_limits(STRICT)}"
    loosely = any(t.loose != t.strict for t in trials if t.condition != CONTROL)
    return [done, f"{held}; loosely: {_limits(LOOSE)}" if loosely else held]


def pressing(normal_force: float, forces: Sequence[float]) -> str:
    """Return the fingers' normal forces as text: the requested least, and the range where they differ.

    Parameters
    ----------
    normal_force : float
        Requested least normal force of each finger, newtons.
    forces : sequence of float
        Normal force of each finger, newtons; may be empty.
    """
    told = f"each finger presses with at least {rounded(normal_force)} N"
    ends = [rounded(end(forces)) for end in (min, max)] if forces else []
    return told if len(set(ends)) < 2 else f"{told} ({ends[0]} to {ends[1]} N)"


def _limits(limits: tuple[float, float]) -> str:
    """Return the motion limits as text, in centimetres and degrees."""
    return f"{100.0 * limits[0]:.0f} cm and {np.degrees(limits[1]):.0f} degrees"
