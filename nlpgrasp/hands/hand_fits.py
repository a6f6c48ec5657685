"""Spheres for all links of a hand, with room for its fingertips to touch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nlpgrasp.hands.link_spheres import SphereFit, fit_spheres
from nlpgrasp.hands.link_tree import LinkTree
from nlpgrasp.hands.robot import Robot

PALM_SHARE = 5  # the palm is broad: it gets so many times the spheres of a finger's link


def fits_of(robot: Robot, per_link: int) -> dict[str, SphereFit]:
    """Return spheres around each link that has a collision shape, at most so many (more for the palm)."""
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
    """Return the spheres, those fixed to a fingertip as small as lets it touch, those inside one left out."""
    result = {}
    for link, fit in whole.items():
        for other, tip in tree.tips:
            transform = tree.rigid(link, other)
            if transform is not None:
                there = fit.centres @ transform[:3, :3].T + transform[:3, 3]
                inside = np.linalg.norm(there - tip.centre, axis=1) + fit.radii <= tip.standoff * (1.0 + 1e-6)
                fit = fit.limited(tip.most_radius(there) - clearance, inside)
        if len(fit.radii):
            result[link] = fit
    return result
