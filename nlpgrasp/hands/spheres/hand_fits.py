"""Collision spheres for all links of a hand, reduced next to fingertips so that these can touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nlpgrasp.common.shown.said import warn
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.spheres.link_spheres import SphereFit, fit_spheres, surface_points
from nlpgrasp.hands.spheres.shapes import Shape
from nlpgrasp.hands.tips import Tip
from nlpgrasp.hands.urdf.link_tree import LinkTree

WORTH_A_WARNING = 6e-4  # metres: possible penetration of a link that is warned of
PALM_SHARE = 5  # spheres of the palm over those of a finger's link


def fits_of(robot: Robot, per_link: int) -> dict[str, SphereFit]:
    """Return spheres for each link that has a collision shape, at most ``per_link`` (more for the palm)."""
    result = {}
    known: dict[tuple[bytes, int], SphereFit] = {}
    for link, shapes in robot.shapes.items():
        most = (PALM_SHARE if link == robot.root else 1) * per_link
        key = (b"".join(shape.fingerprint for shape in shapes), most)  # fingers are often alike
        if key not in known:
            known[key] = fit_spheres(shapes, most)
        result[link] = known[key]
    return result


def fits_beside_tips(whole: Mapping[str, SphereFit], tree: LinkTree, clearance: float) -> dict[str, SphereFit]:
    """Return the spheres with those rigidly connected to a fingertip shrunk or removed so that it can touch."""
    result = {}
    for link, fit in whole.items():
        beside: list[tuple[FloatArray, Tip]] = []
        for other, tip in tree.tips:
            transform = tree.rigid(link, other)
            if transform is not None:
                there = fit.centres @ transform[:3, :3].T + transform[:3, 3]
                ball = 0.0 if tip.slides else tip.standoff  # a sliding tip's ball is not fixed to the link
                inside = np.linalg.norm(there - tip.centre, axis=1) + fit.radii <= ball * (1.0 + 1e-6)
                fit = fit.limited(tip.most_radius(there) - clearance, inside)
                beside.append((transform, tip))
        if beside:
            fit = replace(fit, uncovered=_uncovered(tree.robot.shapes[link], fit, beside))
            if fit.uncovered > WORTH_A_WARNING:
                deep = f"{1e3 * fit.uncovered:.1f} mm"
                text = f"link {link} is thicker than its fingertip: beside a contact it may reach {deep} into the body"
                warn(text)
        if len(fit.radii):
            result[link] = fit
    return result


def _uncovered(shapes: Sequence[Shape], fit: SphereFit, beside: Sequence[tuple[FloatArray, Tip]]) -> float:
    """Return how far the shapes stick out of the spheres and the fingertip solids, metres."""
    points, _ = surface_points(shapes, np.random.default_rng(0))
    gaps = [tip.beyond(points @ T[:3, :3].T + T[:3, 3]) for T, tip in beside]
    if len(fit.radii):
        gaps.append(np.min(np.linalg.norm(points[:, None] - fit.centres, axis=2) - fit.radii, axis=1))
    return max(0.0, float(np.max(np.min(gaps, axis=0))))
