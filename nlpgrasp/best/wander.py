"""Grasps drawn at random and exchanged: designs of many contacts spread so far that their heaviest rows say little."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.best.climb import Climber
from nlpgrasp.best.exchange import Exchange, Places
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.spots import Spot
from nlpgrasp.common.validation import FloatArray

MANY = 5  # contacts
DRAWN, SHAKEN, PLACES = 4, 2, 400  # such grasps, how often each begins again, and places of a contact


def wander(scope: Scope, climber: Climber, rng: np.random.Generator) -> list[tuple[Sequence[Spot], FloatArray]]:
    """Return grasps that exchanges of one contact at a time lead to from random ones, and directions weak there.

    None with few contacts, or where constraints leave a contact no place that is tried.
    """
    if len(scope.slots) < MANY:
        return []
    surfaces = max(len({s.name for s in pieces.surfaces}) for pieces in scope.pieces)
    exchange = Exchange([Places(p, max(1, PLACES // surfaces)) for p in scope.pieces], climber)
    if not all(len(places.points) for places in exchange.places):
        return []
    drawn = [exchange.drawn(rng) for _ in range(DRAWN)]
    found = exchange.again(exchange.improved(drawn, [exchange.spread] * DRAWN), rng, SHAKEN)
    return [(one.spots, one.latest) for one in found]
