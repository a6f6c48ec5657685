"""Straight paths of a hand's variables: collision check and certified least clearance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.clearance import HandClearance

LARGEST_STEP = 1.0 / 8.0  # first and largest step, as a share of the path
CLEARANCE_ACCURACY = 1e-4  # metres, accuracy of the certified clearance
MAX_ROUNDS = 5  # rounds in which postures are added for the certified clearance, at most


@dataclass(frozen=True)
class PathPosture:
    """Posture on a path, with its clearances.

    Parameters
    ----------
    share : float
        Share of the path, from 0 to 1.
    values : dict
        Of the hand's variables.
    clearances : (n,) array
        All clearances there, metres.
    """

    share: float
    values: Values
    clearances: FloatArray


@dataclass(frozen=True)
class StraightPath:
    """Collision-free beginning of a straight path.

    Parameters
    ----------
    postures : tuple of PathPosture
        From the start on; empty where the start is not free.
    blocked_by : str
        The obstruction after the last posture; empty where the path is free to its end.
    moving_joints : (m,) bool array
        The free joints that move the obstructed links.
    """

    postures: tuple[PathPosture, ...]
    blocked_by: str
    moving_joints: BoolArray

    @property
    def free_share(self) -> float:
        """Fraction of the path that is collision-free."""
        return self.postures[-1].share if self.postures else 0.0


def follow_straight_path(
    model: HandClearance,
    posture: Callable[[float], Values],
    clearance_limits: Callable[[PathPosture], FloatArray],
    locate: bool = True,
) -> StraightPath:
    """Return the collision-free beginning of a straight path, with postures dense enough to certify it.

    Parameters
    ----------
    model : HandClearance
    posture : callable
        Share of the path, from 0 to 1, to values of the hand's variables, linear in it; the palm does not turn.
    clearance_limits : callable
        First posture to the least admissible clearances, (n,), metres.
    locate : bool
        Whether to locate the end of the free part to the tolerance; else the search ends once a collision is known.
    """

    def at(fractions: FloatArray) -> list[PathPosture]:
        postures = [posture(fraction) for fraction in fractions.tolist()]
        return [
            PathPosture(*row) for row in zip(fractions.tolist(), postures, model.clearances_of(postures), strict=True)
        ]

    first = at(np.zeros(1))[0]
    limits = clearance_limits(first)
    if np.any(first.clearances < limits - model.tolerance / 2.0):
        worst = int(np.argmin(first.clearances - limits))
        return StraightPath((), model.describe_clearance(worst), model.moving_joints(worst))
    postures, largest = [first], LARGEST_STEP
    whole = np.maximum(model.clearance_change_bounds(first.values, posture(1.0)), 1e-12)
    while postures[-1].share < 1.0:
        # as far as clearances like those here certify, and that several times, evaluated together
        certified = np.min(2.0 * (postures[-1].clearances - limits + model.between) / whole, initial=np.inf)
        step = float(np.clip(certified, largest / 64.0, largest))
        for end in at(np.unique(np.minimum(postures[-1].share + step * np.arange(1, 7), 1.0))):
            start = postures[-1]
            change_bounds = model.clearance_change_bounds(start.values, end.values)
            bound = model.clearance_bounds(start.values, end.values, (start.clearances, end.clearances)) - limits
            slack = end.clearances - limits + model.tolerance / 2.0
            spare = np.where(change_bounds > 0.0, np.minimum(bound + model.between, slack), np.inf)
            if np.any(spare < 0.0):
                break
            postures.append(end)
        else:
            largest = min(2.0 * largest, LARGEST_STEP)
            continue
        if np.max(change_bounds) <= model.tolerance / 2.0 or (not locate and np.any(slack < 0.0)):
            # a step within half the tolerance is free where both of its ends are: its end is not
            worst = int(np.argmin(slack if np.any(slack < 0.0) else spare))
            return StraightPath(tuple(postures), model.describe_clearance(worst), model.moving_joints(worst))
        largest = (end.share - start.share) / 2.0
    return StraightPath(tuple(postures), "", np.zeros(model.motion_bounds.shape[1], bool))


def certified_clearance(model: HandClearance, postures: Sequence[PathPosture]) -> float:
    """Return a lower bound on the clearance of links along a path, metres, from body and obstacles.

    It holds anywhere on the straight paths between the postures, by ``HandClearance.clearance_bounds``: within 0.1 mm
    of the least one, or less accurate after ``MAX_ROUNDS`` rounds of further postures. From tables and obstacles it
    counts beyond the required clearance.

    Parameters
    ----------
    model : HandClearance
    postures : sequence of PathPosture
        Free ones, such as ``follow_straight_path`` returns; the palm does not turn.
    """
    count, samples = model.from_fields(), list(postures)
    for rounds in range(MAX_ROUNDS + 1):
        clearances = np.array([sample.clearances[:count] for sample in samples])
        changes = [model.clearance_change_bounds(a.values, b.values)[:count] for a, b in pairwise(samples)]
        bounds = (
            np.min(clearances[:-1] + clearances[1:] - np.reshape(changes, (-1, count)), axis=1, initial=np.inf) / 2.0
        )
        least = float(np.min(clearances))
        loose = np.flatnonzero(bounds < least - CLEARANCE_ACCURACY)
        if not len(loose) or rounds == MAX_ROUNDS:
            break
        pairs = [(samples[i], samples[i + 1]) for i in loose]
        middles = [{name: (v + b.values[name]) / 2.0 for name, v in a.values.items()} for a, b in pairs]
        for i, (a, b), values, row in reversed(
            list(zip(loose, pairs, middles, model.clearances_of(middles), strict=True))
        ):
            samples.insert(int(i) + 1, PathPosture((a.share + b.share) / 2.0, values, row))
    return min(least, float(np.min(bounds, initial=np.inf)))
