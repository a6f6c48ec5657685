"""Distances between the visible surface of links and their collision shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.mjcf_reader import mjcf_visible_shapes
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.urdf_reader import urdf_visible_shapes

SAMPLES = 1000  # points on the surface of a link
SHARE = 0.98  # share of them within the distance that is stated: screws and cables are no surface
NOTICEABLE = 3e-3  # metres
MOST_NAMED = 4  # links


def visible_gaps(robot: Robot, links: Iterable[str]) -> dict[str, float]:
    """Return the distance between visible surface and collision shapes of each link where it is noticeable, metres.

    It is the distance that holds for 98 % of the surface: of visible points outside the collision shapes, and of points
    on these outside the hull of what is visible. Links without one of both, or whose visible meshes cannot be read, are
    left out.
    """
    if robot.path is None:
        return {}
    shaped = [link for link in links if robot.shapes.get(link)]
    try:
        read = urdf_visible_shapes if _is_urdf(robot.path) else mjcf_visible_shapes
        visible = read(robot.path, shaped, robot.units)
    except (NlpgraspError, OSError, ET.ParseError):  # a mesh that cannot be read, or a file that is gone by now
        return {}
    gaps, alike = dict[str, float](), dict[bytes, float]()  # fingers are often alike
    for link in shaped:
        if visible.get(link):
            key = b"and".join(shape.fingerprint for shape in (*visible[link], *robot.shapes[link]))
            if key not in alike:
                alike[key] = _gap(visible[link], robot.shapes[link])
            gaps[link] = alike[key]
    return {link: gap for link, gap in gaps.items() if gap > NOTICEABLE}


def visible_warning(robot: Robot, links: Iterable[str]) -> str:
    """Return the sentence on links whose collision shapes are not what is visible, a few of them; empty without any."""
    gaps = visible_gaps(robot, links)
    worst = sorted(gaps, key=lambda link: -gaps[link])
    if not worst:
        return ""
    names = ", ".join(f"{link} (up to {format_number(1e3 * gaps[link], 2)} mm)" for link in worst[:MOST_NAMED])
    more = f" and {len(worst) - MOST_NAMED} more" if len(worst) > MOST_NAMED else ""
    return f"grasps are found for the collision shapes, which are not the visible hand at {names}{more}"


def _is_urdf(path: Path) -> bool:
    """Return whether a robot file is a URDF, and not an MJCF."""
    _, root = next(iter(ET.iterparse(path, events=("start",))))  # noqa: S314  (the user's own file)
    return bool(root.tag == "robot")


def _gap(visible: Sequence[CollisionShape], shapes: Sequence[CollisionShape]) -> float:
    """Return the distance within which most of the visible surface and of the collision shapes are of each other."""
    import trimesh

    hull = trimesh.util.concatenate([shape.mesh for shape in visible]).convex_hull
    outside = -np.max([shape.depth(_samples(visible)) for shape in shapes], axis=0)
    beyond = -CollisionShape("mesh", hull).depth(_samples(shapes))
    return max(0.0, float(np.quantile(outside, SHARE)), float(np.quantile(beyond, SHARE)))


def _samples(shapes: Sequence[CollisionShape]) -> FloatArray:
    """Return points on shapes, uniform over their surface, (m, 3), metres, link frame."""
    areas = np.array([shape.mesh.area for shape in shapes])
    counts = np.maximum(SAMPLES * areas / np.sum(areas), 1).astype(int)
    points = [shape.mesh.sample(int(count), seed=0) for shape, count in zip(shapes, counts, strict=True)]
    return np.concatenate([np.asarray(part) for part in points])
