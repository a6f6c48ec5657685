"""Certified least clearance of a hand along a path, between its postures as well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.space.straight import Place
from nlpgrasp.motion.space.surroundings import Surroundings

FINE = 1e-4  # metres, accuracy of the clearance
MOST = 24  # further postures computed, at most


def least_room(around: Surroundings, places: Sequence[Place]) -> float:
    """Return a certified least clearance of links and fingertips, metres, from the body and obstacles along a path.

    To a tenth of a millimetre what the balls have anywhere on the straight ways from place to place, by the bound of
    ``Surroundings.between``; where it takes more than a few places to see that, less than they have. From tables and
    obstacles it counts beyond the clearance asked for.

    Parameters
    ----------
    around : Surroundings
    places : sequence of Place
        Free ones, such as ``straight_way`` returns; the palm does not turn.
    """
    things = len(around.fields) * len(around.seen)
    asked = np.zeros(things)
    asked[: len(around.seen)] = np.where(around.balls.fingers[around.seen] < 0, around.hand.clearance, 0.0)
    known = list(places)
    rooms = [place.clearances[:things] + asked for place in known]

    def proved(i: int) -> float:
        ways = around.swept(known[i].values, known[i + 1].values)[:things]
        return float(np.min((rooms[i] + rooms[i + 1] - ways) / 2.0))

    bounds = [proved(i) for i in range(len(known) - 1)]
    for _ in range(MOST):
        i = int(np.argmin(bounds)) if bounds else 0
        if not bounds or bounds[i] >= _least(rooms) - FINE:
            return _least(rooms)
        values = {name: (v + known[i + 1].values[name]) / 2.0 for name, v in known[i].values.items()}
        share = (known[i].share + known[i + 1].share) / 2.0
        known.insert(i + 1, Place(share, values, around.clearances(values)))
        rooms.insert(i + 1, known[i + 1].clearances[:things] + asked)
        bounds[i : i + 1] = [proved(i), proved(i + 1)]
    return min(bounds)


def _least(rooms: Sequence[FloatArray]) -> float:
    return min(float(np.min(room)) for room in rooms)
