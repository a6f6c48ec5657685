"""How far contacts stay away from sharp edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand

SHARE = 0.05  # of the body's shortest extent
PATCH = 0.5  # of a fingertip's radius: where one that flattens by an eighth of it touches, (2 r r / 8)^(1/2)
OFF, SMALL = 0.001, 0.2  # metres that contacts may be off by, and the share of a small body that this may take
MOST = 0.1  # of the shortest extent, whatever the fingertips
ROOM = 0.5  # of the widest room that is left, where the rest is more than the faces have


def margin_of(given: float | None, body: Body, hand: Hand | None, faces: Sequence[Sequence[str]]) -> float:
    """Return the distance of contacts from edges at which the surface turns by more than 30 degrees, metres.

    Parameters
    ----------
    given : float or None
        None for the default: half the largest fingertip's radius, where a fingertip has one, up to a tenth of the
        body's shortest extent, else a twentieth of that; at least a millimetre, by which contacts may be off, up to a
        fifth of the extent; less where faces have no room for it.
    body : Body
    hand : Hand or None
    faces : sequence of k sequences of str
        That each contact may use.

    Raises
    ------
    InputError
        On a margin that is no length, or that leaves some contact no face.
    """
    each = {name: body.room(name) for name in {name for own in faces for name in own}} if given != 0.0 else {}
    room = min((max(each[name] for name in own) for own in faces if own and each), default=np.inf)
    if given is None:
        shortest = float(np.min(np.ptp(body.bounds, axis=0)))
        radius = 0.0 if hand is None else max(hand.tip_radii)
        least = min(OFF, SMALL * shortest)
        wanted = max(min(PATCH * radius, MOST * shortest) if radius > 0.0 else SHARE * shortest, least)
        return min(wanted, ROOM * room) if np.isfinite(room) or any(np.isfinite(list(each.values()))) else 0.0
    margin = number("GraspProblem.edge_margin", given, at_least=0.0)
    if margin >= room:
        tight = max(each, key=lambda name: each[name])
        raise InputError(
            "GraspProblem.edge_margin",
            f"{margin:g} m, which leaves some contact no face",
            f"less than {room:.4g} m, with which something is left of {tight}",
        )
    return margin
