"""Clearance constraints of round fingertips against other parts of a non-convex body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.common.rows import ROOM
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array
from nlpgrasp.verify.check import NO_BODY, NotMadeError
from nlpgrasp.verify.placement import StatedPlacement, Surface
from nlpgrasp.verify.rows import RowValue

FITS = 0.99  # least distance of a fingertip's centre from the body, in its radii
TURNED = 1e-9  # radians: least right turn of a reentrant corner
HOLLOW = ("torus", "mesh")  # and polygons with a reentrant corner


def room_rows(body: Json, surface: Surface | None, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the distance of each round fingertip's centre from a body that is possibly not convex."""
    if not (body["type"] in HOLLOW or (body["type"] == "polygon" and _points_inwards(body))):
        return
    round_tips = [i for i, radius in enumerate(placement.radii) if radius > 0.0]
    if not round_tips:
        return
    if surface is None:
        raise NotMadeError(NO_BODY)
    for i in round_tips:
        value = float(surface.distance(placement.tips[i][None])[0])
        yield RowValue(f"{ROOM}, finger {i}", value, FITS * placement.radii[i], scale=placement.size)


def _points_inwards(body: Json) -> bool:
    v = array("vertices", body["vertices"], (None, 2))
    along = np.roll(v, -1, axis=0) - v
    angles = np.arctan2(along[:, 1], along[:, 0])
    turns = (np.roll(angles, -1) - angles + np.pi) % (2.0 * np.pi) - np.pi
    return bool(np.any(turns < -TURNED))
