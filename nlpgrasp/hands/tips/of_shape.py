"""The fingertip that a link's own collision shape is, or one about as large."""

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


def sphere_about(shapes: Sequence[Shape]) -> SphereTip | None:
    """Return a sphere as thick as the shapes of a link, about their middle; None where there are none."""
    if not shapes:
        return None
    low = np.min([shape.mesh.bounds[0] for shape in shapes], axis=0)
    high = np.max([shape.mesh.bounds[1] for shape in shapes], axis=0)
    return SphereTip(float(np.min(high - low)) / 2.0, (low + high) / 2.0)
