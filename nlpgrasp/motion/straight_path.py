"""Straight paths of a hand's variables: collision check and certified least clearance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.link_clearance import CollisionModel

LARGEST_STEP = 1.0 / 8.0  # first and largest step, as a share of the path
CLEARANCE_ACCURACY = 1e-4  # metres, accuracy of the certified clearance
MAX_REFINEMENTS = 24  # largest number of further postures for the certified clearance


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
        The free joints that move the obstructed spheres.
    """

    postures: tuple[PathPosture, ...]
    blocked_by: str
    moving_joints: BoolArray

    @property
    def free_share(self) -> float:
        """Fraction of the path that is collision-free."""
        return self.postures[-1].share if self.postures else 0.0


def follow_straight_path(
    model: CollisionModel,
    posture: Callable[[float], Values],
    clearance_limits: Callable[[PathPosture], FloatArray],
    locate: bool = True,
) -> StraightPath:
    """Return the collision-free beginning of a straight path, with postures dense enough to certify it.

    Parameters
    ----------
    model : CollisionModel
    posture : callable
        Share of the path, from 0 to 1, to values of the hand's variables, linear in it; the palm does not turn.
    clearance_limits : callable
        First posture to the least admissible clearances, (n,), metres.
    locate : bool
        Whether to locate the end of the free part to the tolerance; else the search ends once a collision is known.
    """

    def at(fraction: float) -> PathPosture:
        values = posture(fraction)
        return PathPosture(fraction, values, model.clearances(values))

    first = at(0.0)
    limits = clearance_limits(first)
    if np.any(first.clearances < limits - model.tolerance / 2.0):
        worst = int(np.argmin(first.clearances - limits))
        return StraightPath((), model.describe_clearance(worst), model.moving_joints(worst))
    postures, step = [first], LARGEST_STEP
    while postures[-1].share < 1.0:
        start = postures[-1]
        end = at(min(start.share + step, 1.0))
        change_bounds = model.clearance_change_bounds(start.values, end.values)
        bound = model.clearance_bounds(start.values, end.values, (start.clearances, end.clearances)) - limits
        slack = end.clearances - limits + model.tolerance / 2.0
        spare = np.where(change_bounds > 0.0, np.minimum(bound + model.tolerance, slack), np.inf)
        if np.all(spare >= 0.0):
            postures.append(end)
            step = min(2.0 * step, LARGEST_STEP)
        elif np.max(change_bounds) <= model.tolerance / 2.0 or (not locate and np.any(slack < 0.0)):
            # a step within half the tolerance is free where both of its ends are: its end is not
            worst = int(np.argmin(slack if np.any(slack < 0.0) else spare))
            return StraightPath(tuple(postures), model.describe_clearance(worst), model.moving_joints(worst))
        else:
            step = (end.share - start.share) / 2.0
    return StraightPath(tuple(postures), "", np.zeros(model.spheres.motion_bounds.shape[1], bool))


def certified_clearance(model: CollisionModel, postures: Sequence[PathPosture]) -> float:
    """Return a lower bound on the clearance of links and fingertips along a path, metres, from body and obstacles.

    A lower bound on the clearance of the spheres anywhere on the straight paths between the postures, by
    ``CollisionModel.clearance_bounds``: within a tenth of a millimetre of the true value, or less accurate after
    ``MAX_REFINEMENTS`` further postures. From tables and obstacles it counts beyond the required clearance.

    Parameters
    ----------
    model : CollisionModel
    postures : sequence of PathPosture
        Free ones, such as ``follow_straight_path`` returns; the palm does not turn.
    """
    count = len(model.fields) * len(model.sphere_indices)
    required = np.zeros(count)
    required[: len(model.sphere_indices)] = np.where(
        model.spheres.fingers[model.sphere_indices] < 0, model.hand.clearance, 0.0
    )
    samples = list(postures)
    clearances = [sample.clearances[:count] + required for sample in samples]

    def bound(i: int) -> float:
        changes = model.clearance_change_bounds(samples[i].values, samples[i + 1].values)[:count]
        return float(np.min((clearances[i] + clearances[i + 1] - changes) / 2.0))

    bounds = [bound(i) for i in range(len(samples) - 1)]
    for _ in range(MAX_REFINEMENTS):
        i = int(np.argmin(bounds)) if bounds else 0
        if not bounds or bounds[i] >= _least_value(clearances) - CLEARANCE_ACCURACY:
            return _least_value(clearances)
        values = {name: (v + samples[i + 1].values[name]) / 2.0 for name, v in samples[i].values.items()}
        share = (samples[i].share + samples[i + 1].share) / 2.0
        samples.insert(i + 1, PathPosture(share, values, model.clearances(values)))
        clearances.insert(i + 1, samples[i + 1].clearances[:count] + required)
        bounds[i : i + 1] = [bound(i), bound(i + 1)]
    return min(bounds)


def _least_value(clearances: Sequence[FloatArray]) -> float:
    """Return the least element of several arrays."""
    return min(float(np.min(values)) for values in clearances)
