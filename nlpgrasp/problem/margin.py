"""Margin of contacts from sharp edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand

SHARE = 0.05  # of the body's shortest extent
PATCH = 0.5  # of a fingertip's radius: patch radius when it flattens by r / 8, (2 r r / 8)^(1/2)
OFF, SMALL = 0.001, 0.2  # m, least margin; its largest share of the shortest extent
MOST = 0.1  # of the shortest extent: largest margin due to fingertips
ROOM = 0.5  # of the largest possible margin: upper limit of the default


def margin_of(given: float | None, body: Body, hand: Hand | None, faces: Sequence[Sequence[str]]) -> float:
    """Return the validated or default margin of contacts from sharp edges (above 30 degrees), metres.

    Parameters
    ----------
    given : float or None
        None for the default: half the largest fingertip's radius, at most a tenth of the body's shortest extent;
        without fingertip radii, a twentieth of that extent. At least a millimetre, but at most a fifth of the extent;
        less if the faces are too small.
    body : Body
    hand : Hand or None
    faces : sequence of k sequences of str
        Allowed faces of each contact.

    Raises
    ------
    InputError
        On an invalid margin, or one that leaves some contact no face.
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
