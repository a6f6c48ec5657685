"""3D scene of a hand: link surfaces, collision spheres, fingertips and camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies.mesh.triangles import simplified
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.report.hand.tree import listed
from nlpgrasp.report.scene.axes import frame_axes
from nlpgrasp.report.scene.camera import TILTS, TURNS
from nlpgrasp.report.scene.surfaces import surface

MOST, FEWEST, ALL = 3000, 200, 60_000  # most and least triangles of a shape, most of all together
DIGITS = 7  # decimals of coordinates for display, metres
AXIS = 0.2  # length of the palm's axes, as a share of the hand's size
DOT = 0.012  # share of the hand's size: mark of a possible fingertip
ABOVE = 0.05  # weight of a view from above over one from below
FACED = 0.35  # weight of a view into the palm, relative to the broadest view
PADS = 1.5  # weight of a view at the fingertips' patches


def scene(hand: Inspected, most: int = ALL) -> Json:
    """Return the scene of a hand; metres, in each link's frame.

    Parameters
    ----------
    hand : Inspected
    most : int
        Approximate largest number of triangles of all links together.

    Returns
    -------
    dict
        ``surfaces``: distinct surfaces. ``parts``: link number and surface. ``spheres``: link number, centre and radius
        of each sphere. ``tips``: link number, name, surface, centre. ``leaves``: numbers of the links that may have a
        fingertip, if none are stated. ``corners``: link number and corners of its shapes' bounding box, for framing.
        ``approach``: origin and unit direction, palm frame. ``axes``: of the palm's frame. ``size``, ``dot``: of the
        hand and of a leaf's mark. ``view``: azimuth and elevation of the camera, degrees.
    """
    robot = hand.tree.robot
    index = {name: i for i, name in enumerate(robot.links)}
    surfaces: list[Json] = []
    known: dict[bytes, int] = {}

    def kept(key: bytes, shape: Triangles) -> int:
        if key not in known:
            known[key] = len(surfaces)
            surfaces.append(surface(shape).to_dict())
        return known[key]

    parts, corners = [], []
    each = max(FEWEST, min(MOST, most // max(1, sum(map(len, robot.shapes.values())))))
    for link, shapes in robot.shapes.items():
        for shape in shapes:
            vertices, faces = np.asarray(shape.mesh.vertices, dtype=float), np.asarray(shape.mesh.faces)
            drawn = Triangles(*simplified(vertices, faces, each))
            parts.append({"link": index[link], "surface": kept(shape.fingerprint, drawn)})
            corners.append({"link": index[link], "at": _corners(vertices)})
    tips = []
    for link, tip in hand.tree.tips:
        drawn = tip.surface()
        key = drawn.vertices.round(9).tobytes()
        entry = {"link": index[link], "name": link, "surface": kept(key, drawn)}
        tips.append(entry | {"at": listed(tip.backbone.mean(axis=0), DIGITS), "radius": tip.standoff})
        corners.append({"link": index[link], "at": _corners(drawn.vertices)})
    leaves = [] if tips else [index[link] for link in hand.leaves]
    corners += [{"link": i, "at": [[0.0, 0.0, 0.0]]} for i in leaves]
    if not corners:
        corners = [{"link": i, "at": [[0.0, 0.0, 0.0]]} for i in range(len(robot.links))]
    points = _placed(hand, corners)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-3)
    return {
        "surfaces": surfaces,
        "parts": parts,
        "spheres": [{"link": index[k], "balls": _balls(fit.centres, fit.radii)} for k, fit in hand.fits.items()],
        "tips": tips,
        "leaves": leaves,
        "corners": corners,
        "approach": {"at": _palm(hand), "along": listed(hand.tree.approach)},
        "axes": frame_axes(np.zeros(3), np.full(3, AXIS * size)),
        "size": size,
        "dot": DOT * size,
        "view": _view(points, hand),
    }


def _corners(vertices: FloatArray) -> list[list[float]]:
    """Return the corners of the bounding box of points."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    every = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    return [listed(corner, DIGITS) for corner in every]


def _balls(centres: FloatArray, radii: FloatArray) -> list[list[float]]:
    return [listed(ball, DIGITS) for ball in np.column_stack([centres, radii])]


def _palm(hand: Inspected) -> list[float]:
    """Return the origin of the drawn palm direction: the far side of the palm's shapes, or the palm's origin."""
    shapes = hand.tree.robot.shapes.get(hand.tree.robot.root, ())
    if not shapes:
        return [0.0, 0.0, 0.0]
    vertices = np.concatenate([np.asarray(shape.mesh.vertices, dtype=float) for shape in shapes])
    middle, along = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0, hand.tree.approach
    return listed(middle + np.max((vertices - middle) @ along) * along, DIGITS)


def _poses(hand: Inspected) -> dict[str, FloatArray]:
    """Return the poses (4, 4) of the used links, palm frame, in the relaxed posture."""
    names = hand.tree.used_links
    if not names:
        return {}
    found = np.asarray(hand.tree.link_function(hand.at_rest).full()).reshape(4, len(names), 4)
    return {name: found[:, i] for i, name in enumerate(names)}


def _placed(hand: Inspected, corners: Sequence[Json]) -> FloatArray:
    """Return the used links' corners (n, 3) in the palm's frame, and the palm's origin."""
    poses, links = _poses(hand), hand.tree.robot.links
    placed = [np.zeros((1, 3))]
    for entry in corners:
        pose = poses.get(links[int(entry["link"])])
        if pose is not None:
            placed.append(np.asarray(entry["at"]) @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(placed)


def _facing(hand: Inspected) -> FloatArray:
    """Return the mean outward normal of each fingertip's patch, (k, 3), palm frame; zero for a ball."""
    poses, means = _poses(hand), [np.zeros((0, 3))]
    for link, tip in hand.tree.tips:
        shape = tip.surface()
        corners = shape.vertices[shape.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        mean = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        means.append((poses[link][:3, :3] @ mean)[None])
    return np.concatenate(means)


def _view(points: FloatArray, hand: Inspected) -> list[float]:
    """Return azimuth and elevation, degrees, of a view that is broad, into the palm and at flat fingertips."""
    turn, tilt = (x.ravel() for x in np.meshgrid(TURNS, [*TILTS, *-TILTS], indexing="ij"))
    eyes = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], axis=1)
    centred = points - points.mean(axis=0)
    total = float(np.sum(centred**2)) or 1.0
    broad = 1.0 - np.sum((centred @ eyes.T) ** 2, axis=0) / total
    into = np.clip(eyes @ hand.tree.approach, None, 0.8)
    pads = np.clip(eyes @ _facing(hand).T, 0.0, 0.5).sum(axis=1) / max(len(hand.tree.tips), 1)
    best = int(np.argmax(broad + FACED * into + PADS * pads + ABOVE * np.sign(tilt)))
    return [float(np.degrees(turn[best])), float(np.degrees(tilt[best]))]
