"""Fingertips from collision shapes, and their overhang beyond the shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.spheres.shapes import Shape
from nlpgrasp.hands.tips.base import Tip
from nlpgrasp.hands.tips.capsule import CapsuleTip
from nlpgrasp.hands.tips.sphere import SphereTip


def tip_of(shapes: Sequence[Shape]) -> Tip | None:
    """Return the patch of a link's only sphere or capsule; None where there is not exactly one.

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


def overhang(tip: Tip, link: str, robot: Robot) -> float | None:
    """Return how far a fingertip's patch reaches beyond the shapes of its rigid group of links, metres.

    Where the patch is beyond them, the finger itself does not touch. None if none of these links has a shape. Links of
    a rigid group do not move against each other, so the result holds in every posture.
    """
    groups, surface = robot.rigid_groups, tip.surface().vertices
    outside = []
    for other, shapes in robot.shapes.items():
        transform = robot.fixed_transform(link, other)
        if groups[other] == groups[link] and transform is not None:
            local = surface @ transform[:3, :3].T + transform[:3, 3]
            outside += [-shape.depth(local) for shape in shapes]
    return max(0.0, float(np.max(np.min(outside, axis=0)))) if outside else None


def sphere_about(shapes: Sequence[Shape]) -> SphereTip | None:
    """Return a sphere about the centre of a link's shapes, as thick as they are; None without shapes."""
    if not shapes:
        return None
    low = np.min([shape.mesh.bounds[0] for shape in shapes], axis=0)
    high = np.max([shape.mesh.bounds[1] for shape in shapes], axis=0)
    return SphereTip(float(np.min(high - low)) / 2.0, (low + high) / 2.0)
