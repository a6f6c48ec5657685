"""Uphill over the body's surface from where designs are heaviest: grasps for the bound to be compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.best.bound.weakest import descended
from nlpgrasp.best.spots import Spot, Spots, designs
from nlpgrasp.best.uphill import uphill
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task

ROUNDS = 15
FIRST, LONGEST, LEAST = 0.1, 0.3, 2e-4  # steps, relative to the body's size
CUTS, KEPT = 40, 10  # directions in a step's program; of the latest
SPREAD, DESCENT = 24, 8  # well-spread directions that descents begin from too, the weakest; their steps
GAIN = 1e-6
HOPE = 1.0  # share of mu, over the rounds so far, that a climb may lack


class Climb:
    """Where one climb stands.

    Parameters
    ----------
    spots : sequence of Spot
    value : float
        What its mu seems to be.
    cuts : (m, d) array
        Directions known to be weak, the latest first.
    step : float
        How far a contact may go next, metres.
    """

    def __init__(self, spots: Spots, value: float, cuts: FloatArray, step: float) -> None:
        self.spots, self.value, self.cuts, self.step, self.going = list(spots), value, cuts, step, True

    def shorten(self, size: float) -> None:
        """Try a shorter step, until that is next to nothing."""
        self.step *= 0.35
        self.going = self.step >= LEAST * size

    def judge(self, moved: Spots, value: float, weak: FloatArray, size: float) -> None:
        """Take a step's end where it is better; otherwise try a shorter one, until that is next to nothing."""
        self.cuts = np.concatenate([weak[:KEPT], self.cuts])[:CUTS]
        if value > (1.0 + GAIN) * self.value:
            self.spots, self.value, self.step = list(moved), value, min(1.5 * self.step, LONGEST * size)
        else:
            self.shorten(size)


class Climber:
    """Raises mu of grasps by small linear programs: all directions that may become the weakest rise alike.

    Parameters
    ----------
    task : Task
    twists : (m, d) array
        Well-spread directions with unit work of the task, to begin with.
    size : float
        Of the body, metres.
    """

    def __init__(self, task: Task, twists: FloatArray, size: float) -> None:
        self.task, self.twists, self.size = task, twists, size

    def learn(self, twists: FloatArray) -> None:
        """Begin descents from these directions (m, d) as well, where they are weak."""
        self.twists = np.concatenate([self.twists, twists])

    def climb(
        self, grasps: Sequence[Spots], twists: Sequence[FloatArray], known: float = 0.0
    ) -> list[tuple[list[Spot], float]]:
        """Return grasps uphill of these, side by side, and what the mu of each seems to be.

        Parameters
        ----------
        grasps : sequence of b sequences of k Spot
            Their contacts alike.
        twists : sequence of b (m, d) arrays
            Directions that are weak there.
        known : float
            The mu to exceed: a climb that stays far below it ends early.
        """
        begun = zip(grasps, self.weakest(grasps, twists), strict=True)
        climbs = [Climb(spots, value, cuts, FIRST * self.size) for spots, (value, cuts) in begun]
        for i in range(ROUNDS):
            for climb in climbs:
                climb.going = climb.going and climb.value >= known * (1.0 - HOPE / (1 + i))
            going = [climb for climb in climbs if climb.going]
            if not going:
                break
            self._round(going)
        return [(climb.spots, climb.value) for climb in climbs]

    def _round(self, climbs: Sequence[Climb]) -> None:
        """Try a step of each climb; those without one end, and one that leaves what is allowed is tried shorter."""
        steps = uphill([c.spots for c in climbs], [c.cuts for c in climbs], [c.step for c in climbs], self.size)
        tried: list[tuple[Climb, list[Spot]]] = []
        for climb, moved in zip(climbs, steps, strict=True):
            if moved is None:
                climb.going = False
            elif all(spot.allowed for spot in moved):
                tried.append((climb, moved))
            else:
                climb.shorten(self.size)
        if not tried:
            return
        found = self.weakest([moved for _, moved in tried], [climb.cuts for climb, _ in tried])
        for (climb, moved), (value, weak) in zip(tried, found, strict=True):
            climb.judge(moved, value, weak, self.size)

    def weakest(self, grasps: Sequence[Spots], twists: Sequence[FloatArray]) -> list[tuple[float, FloatArray]]:
        """Return the least ratio that descents find of each grasp, and their directions, weakest first."""
        parts, measure = designs(grasps), grasps[0][0].pieces.supports.measure
        every = np.broadcast_to(self.twists, (len(grasps), *self.twists.shape))
        spread = np.argsort(sum(part.value(every) for part in parts), axis=1)[:, :SPREAD]
        own = np.stack([np.pad(y[:KEPT], ((0, max(0, KEPT - len(y))), (0, 0)), mode="edge") for y in twists])
        found = descended(parts, self.task, np.concatenate([own, self.twists[spread]], axis=1), DESCENT)[0]
        ratios = measure.combined(np.concatenate([part.supports(found) for part in parts], axis=2), 2)
        order = np.argsort(ratios, axis=1)
        return [(float(r[o[0]]), y[o]) for r, y, o in zip(ratios, found, order, strict=True)]
