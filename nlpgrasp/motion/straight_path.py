"""Collision check and certified least clearance of a straight path of a hand's variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.link_clearance import BoolArray, CollisionModel

LARGEST = 1.0 / 8.0  # of the whole path: the first step
FINE = 1e-4  # metres, accuracy of the clearance
MOST = 24  # further postures computed, at most


@dataclass(frozen=True)
class PathPosture:
    """Posture on a path, with its clearances.

    Parameters
    ----------
    share : float
        Of the way, from 0 to 1.
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
    """Collision-free part of a straight path.

    Parameters
    ----------
    places : tuple of PathPosture
        From the start on; empty where the start is not free.
    blocked_by : str
        What is in the way after the last place; empty where the way is free to its end.
    moved_by : (m,) bool array
        The free joints that move what is in the way.
    """

    places: tuple[PathPosture, ...]
    blocked_by: str
    moved_by: BoolArray

    @property
    def free(self) -> float:
        """Share of the path that is collision-free."""
        return self.places[-1].share if self.places else 0.0


def straight_way(
    around: CollisionModel,
    posture: Callable[[float], Values],
    allowed: Callable[[PathPosture], FloatArray],
    locate: bool = True,
) -> StraightPath:
    """Return the postures of a straight path, close enough to certify that nothing lies between them.

    Parameters
    ----------
    around : CollisionModel
    posture : callable
        Share of the way, from 0 to 1, to values of the hand's variables, linear in it; the palm does not turn.
    allowed : callable
        The first place to the least of each clearance, (n,), metres.
    locate : bool
        Whether to find out how far a blocked way is free, to the tolerance; else it ends where that is seen.
    """

    def at(share: float) -> PathPosture:
        values = posture(share)
        return PathPosture(share, values, around.clearances(values))

    first = at(0.0)
    least = allowed(first)
    if np.any(first.clearances < least - around.tolerance / 2.0):
        worst = int(np.argmin(first.clearances - least))
        return StraightPath((), around.describe_clearance(worst), around.moved_by(worst))
    done, step = [first], LARGEST
    while done[-1].share < 1.0:
        here = done[-1]
        there = at(min(here.share + step, 1.0))
        swept = around.clearance_change_bounds(here.values, there.values)
        bound = around.between(here.values, there.values, (here.clearances, there.clearances)) - least
        ends = there.clearances - least + around.tolerance / 2.0
        spare = np.where(swept > 0.0, np.minimum(bound + around.tolerance, ends), np.inf)
        if np.all(spare >= 0.0):
            done.append(there)
            step = min(2.0 * step, LARGEST)
        elif np.max(swept) <= around.tolerance / 2.0 or (not locate and np.any(ends < 0.0)):
            # within half the tolerance the bound holds where both ends do: it is the end that does not
            worst = int(np.argmin(ends if np.any(ends < 0.0) else spare))
            return StraightPath(tuple(done), around.describe_clearance(worst), around.moved_by(worst))
        else:
            step = (there.share - here.share) / 2.0
    return StraightPath(tuple(done), "", np.zeros(around.balls.reach.shape[1], bool))


def certified_clearance(around: CollisionModel, places: Sequence[PathPosture]) -> float:
    """Return a certified least clearance of links and fingertips, metres, from the body and obstacles along a path.

    To a tenth of a millimetre what the balls have anywhere on the straight ways from place to place, by the bound of
    ``CollisionModel.between``; where it takes more than a few places to see that, less than they have. From tables and
    obstacles it counts beyond the clearance asked for.

    Parameters
    ----------
    around : CollisionModel
    places : sequence of PathPosture
        Free ones, such as ``straight_way`` returns; the palm does not turn.
    """
    things = len(around.fields) * len(around.seen)
    asked = np.zeros(things)
    asked[: len(around.seen)] = np.where(around.balls.fingers[around.seen] < 0, around.hand.clearance, 0.0)
    known = list(places)
    rooms = [place.clearances[:things] + asked for place in known]

    def proved(i: int) -> float:
        ways = around.clearance_change_bounds(known[i].values, known[i + 1].values)[:things]
        return float(np.min((rooms[i] + rooms[i + 1] - ways) / 2.0))

    bounds = [proved(i) for i in range(len(known) - 1)]
    for _ in range(MOST):
        i = int(np.argmin(bounds)) if bounds else 0
        if not bounds or bounds[i] >= _least_value(rooms) - FINE:
            return _least_value(rooms)
        values = {name: (v + known[i + 1].values[name]) / 2.0 for name, v in known[i].values.items()}
        share = (known[i].share + known[i + 1].share) / 2.0
        known.insert(i + 1, PathPosture(share, values, around.clearances(values)))
        rooms.insert(i + 1, known[i + 1].clearances[:things] + asked)
        bounds[i : i + 1] = [proved(i), proved(i + 1)]
    return min(bounds)


def _least_value(rooms: Sequence[FloatArray]) -> float:
    return min(float(np.min(room)) for room in rooms)
