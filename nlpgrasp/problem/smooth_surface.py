"""Warning about meshes far from their smoothed surface."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.mesh.fineness import FINEST, automatic_fineness
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.hands import Hand

WALL = 1.0 / 3.0  # of the wall thickness: largest accepted 80th percentile of the distance
FINER = 1.5  # advised factor on the resolution, where less smoothing does not help


def warn_of_smoothing(body: Body, hand: Hand | None) -> None:
    """Warn, once, if a fifth of a mesh is far from the smoothed surface that the solver sees.

    Parameters
    ----------
    body : Body
        Far means more than a third of its wall thickness, or the radius of the hand's smallest fingertip.
    hand : Hand or None
    """
    if not isinstance(body, Mesh):
        return
    tip = min((radius for radius in (() if hand is None else hand.tip_radii) if radius > 0.0), default=np.inf)
    off = body.offset.most
    if off <= min(WALL * body.wall, tip):
        return
    thin = off > WALL * body.wall
    beside = f"walls {1e3 * body.wall:.3g} mm thick" if thin else f"a fingertip of {1e3 * tip:.3g} mm radius"
    advised = automatic_fineness(np.ptp(body.bounds, axis=0), min(body.wall, tip / WALL))
    smoothing, resolution = advised.smoothing, advised.resolution
    if smoothing / resolution >= body.smoothing / body.resolution:
        smoothing, resolution = body.smoothing, min(int(np.ceil(FINER * body.resolution)), FINEST)
    say_once(
        f"{body.source or 'the mesh'}: the smooth surface that the solver works on is {1e3 * off:.3g} mm or more off a "
        f"fifth of the mesh, which is much beside {beside}: ng.Mesh takes smoothing={smoothing:g}, "
        f"resolution={resolution}"
    )
