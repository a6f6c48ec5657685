"""The fingertip that a link's own collision shape is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.hands.spheres.shapes import Shape
from nlpgrasp.hands.tips.base import Tip
from nlpgrasp.hands.tips.capsule import CapsuleTip
from nlpgrasp.hands.tips.sphere import SphereTip


def tip_of(shapes: Sequence[Shape]) -> Tip | None:
    """Return the patch of a link's only sphere or capsule; None where there is no such shape, or several.

    A capsule's end is the one farther from the link's origin.
    """
    round_ones = [shape for shape in shapes if shape.kind in ("sphere", "capsule")]
    if len(round_ones) != 1:
        return None
    shape = round_ones[0]
    if shape.ends is not None and np.ptp(shape.ends, axis=0).any():
        start, end = sorted(shape.ends, key=lambda point: float(np.linalg.norm(point)))
        return CapsuleTip(shape.radius, start, end)
    return None if shape.centre is None else SphereTip(shape.radius, shape.centre)
