"""3D scene of a hand with movable joints, and its controls."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.bodies.mesh.display_triangles import simplify
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.formatting import format_number, typeset
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.finger_chains import Finger, fingers, format_as_list
from nlpgrasp.hands.inspection import InspectedHand
from nlpgrasp.hands.opposition import Opposition
from nlpgrasp.hands.robot import Joint
from nlpgrasp.report.scene_parts import TILTS, TURNS, frame_axes, surface, switches

EXACT_DECIMALS = 12  # decimals of lengths in metres and of cosines
MOST, FEWEST, ALL = 3000, 200, 60_000  # most and least triangles of a shape, most of all together
DISPLAY_DECIMALS = 7  # decimals of coordinates for display, metres
AXIS = 0.2  # length of the palm's axes, as a share of the hand's size
DOT = 0.012  # share of the hand's size: mark of a possible fingertip
ABOVE = 0.05  # weight of a view from above over one from below
FACED = 0.35  # weight of a view into the palm, relative to the broadest view
PADS = 1.5  # weight of a view at the fingertips' patches
ONE_DIGIT = 100.0  # degrees or millimetres below which one decimal is shown
GENERAL = ("relaxed", "zero", "lower limits", "upper limits")
# visibility switches of the scene: group, label, initially shown
SWITCHES = (
    ("links", "Links", True),
    ("spheres", "Spheres", False),
    ("tips", "Fingertips", True),
    ("approach", "Palm direction", True),
    ("triad", "Palm axes", True),
    ("axes", "Joint axes", False),
)
VIEWER = ("shapes.js", "renderer.js", "view.js", "kinematics.js", "hand.js")


def joint_tree(hand: InspectedHand) -> Json:
    """Return links, joints and their drivers.

    Returns
    -------
    dict
        ``links``: names, the palm first. ``joints``: parents before children, each with the numbers of its links
        ``parent`` and ``child``, ``origin`` (the child's frame in the parent's at position 0, the 12 numbers of its
        upper three rows), ``kind`` (fixed, turns, slides), unit ``axis`` in the joint's frame, and for one that moves
        ``driver``, ``multiplier`` and ``offset``: its position is ``multiplier * positions[driver] + offset``.
        ``drivers``: the free joints, with name, whether they turn, and limits, radians or metres.
    """
    robot = hand.tree.robot
    index = {name: i for i, name in enumerate(robot.links)}
    drivers = {joint.name: i for i, joint in enumerate(robot.free_joints)}
    joints = []
    for joint in robot.joints:
        entry = {
            "name": joint.name,
            "parent": index[joint.parent],
            "child": index[joint.child],
            "origin": rounded_list(_origin(joint)[:3].ravel()),
            "kind": "fixed" if not joint.moves else "turns" if joint.is_revolute else "slides",
            "axis": rounded_list(joint.axis),
        }
        if joint.moves:
            driver, multiplier, offset = robot.driving_joint(joint)
            entry |= {"driver": drivers[driver], "multiplier": multiplier, "offset": offset}
        joints.append(entry)
    ranges = [robot.ranges[joint.name] for joint in robot.free_joints]
    free = [
        {"name": joint.name, "turns": joint.is_revolute, "lower": lower, "upper": upper}
        for joint, (lower, upper, _) in zip(robot.free_joints, ranges, strict=True)
    ]
    return {"links": list(robot.links), "joints": joints, "drivers": free}


def _origin(joint: Joint) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", joint.rpy).as_matrix(), joint.xyz
    return pose


def rounded_list(values: FloatArray, digits: int = EXACT_DECIMALS) -> list[float]:
    """Return numbers as a rounded list, without -0."""
    return [float(v) + 0.0 for v in np.round(np.asarray(values, dtype=float), digits)]


def hand_scene(hand: InspectedHand, most: int = ALL) -> Json:
    """Return the scene of a hand; metres, in each link's frame.

    Parameters
    ----------
    hand : InspectedHand
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
            drawn = Triangles(*simplify(vertices, faces, each))
            parts.append({"link": index[link], "surface": kept(shape.fingerprint, drawn)})
            corners.append({"link": index[link], "at": _corners(vertices)})
    tips = []
    for link, tip in hand.tree.tips:
        drawn = tip.surface()
        key = drawn.vertices.round(9).tobytes()
        entry = {"link": index[link], "name": link, "surface": kept(key, drawn)}
        tips.append(entry | {"at": rounded_list(tip.backbone.mean(axis=0), DISPLAY_DECIMALS), "radius": tip.standoff})
        corners.append({"link": index[link], "at": _corners(drawn.vertices)})
    leaves = [] if tips else [index[link] for link in hand.leaves]
    corners += [{"link": i, "at": [[0.0, 0.0, 0.0]]} for i in leaves]
    if not corners:
        corners = [{"link": i, "at": [[0.0, 0.0, 0.0]]} for i in range(len(robot.links))]
    points = _link_corners(hand, corners)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-3)
    return {
        "surfaces": surfaces,
        "parts": parts,
        "spheres": [{"link": index[k], "balls": _sphere_data(fit.centres, fit.radii)} for k, fit in hand.fits.items()],
        "tips": tips,
        "leaves": leaves,
        "corners": corners,
        "approach": {"at": _palm_origin(hand), "along": rounded_list(hand.tree.approach)},
        "axes": frame_axes(np.zeros(3), np.full(3, AXIS * size)),
        "size": size,
        "dot": DOT * size,
        "view": _view(points, hand),
    }


def _corners(vertices: FloatArray) -> list[list[float]]:
    """Return the corners of the bounding box of points."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    every = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    return [rounded_list(corner, DISPLAY_DECIMALS) for corner in every]


def _sphere_data(centres: FloatArray, radii: FloatArray) -> list[list[float]]:
    return [rounded_list(ball, DISPLAY_DECIMALS) for ball in np.column_stack([centres, radii])]


def _palm_origin(hand: InspectedHand) -> list[float]:
    """Return the origin of the drawn palm direction: the far side of the palm's shapes, or the palm's origin."""
    shapes = hand.tree.robot.shapes.get(hand.tree.robot.root, ())
    if not shapes:
        return [0.0, 0.0, 0.0]
    vertices = np.concatenate([np.asarray(shape.mesh.vertices, dtype=float) for shape in shapes])
    middle, along = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0, hand.tree.approach
    return rounded_list(middle + np.max((vertices - middle) @ along) * along, DISPLAY_DECIMALS)


def _relaxed_link_poses(hand: InspectedHand) -> dict[str, FloatArray]:
    """Return the poses (4, 4) of the used links, palm frame, in the relaxed posture."""
    names = hand.tree.used_links
    if not names:
        return {}
    found = np.asarray(hand.tree.link_function(hand.at_rest).full()).reshape(4, len(names), 4)
    return {name: found[:, i] for i, name in enumerate(names)}


def _link_corners(hand: InspectedHand, corners: Sequence[Json]) -> FloatArray:
    """Return the used links' corners (n, 3) in the palm's frame, and the palm's origin."""
    poses, links = _relaxed_link_poses(hand), hand.tree.robot.links
    placed = [np.zeros((1, 3))]
    for entry in corners:
        pose = poses.get(links[int(entry["link"])])
        if pose is not None:
            placed.append(np.asarray(entry["at"]) @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(placed)


def _patch_normals(hand: InspectedHand) -> FloatArray:
    """Return the mean outward normal of each fingertip's patch, (k, 3), palm frame; zero for a ball."""
    poses, means = _relaxed_link_poses(hand), [np.zeros((0, 3))]
    for link, tip in hand.tree.tips:
        shape = tip.surface()
        corners = shape.vertices[shape.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        mean = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        means.append((poses[link][:3, :3] @ mean)[None])
    return np.concatenate(means)


def _view(points: FloatArray, hand: InspectedHand) -> list[float]:
    """Return azimuth and elevation, degrees, of a view that is broad, into the palm and at flat fingertips."""
    turn, tilt = (x.ravel() for x in np.meshgrid(TURNS, [*TILTS, *-TILTS], indexing="ij"))
    eyes = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], axis=1)
    centred = points - points.mean(axis=0)
    total = float(np.sum(centred**2)) or 1.0
    broad = 1.0 - np.sum((centred @ eyes.T) ** 2, axis=0) / total
    into = np.clip(eyes @ hand.tree.approach, None, 0.8)
    pads = np.clip(eyes @ _patch_normals(hand).T, 0.0, 0.5).sum(axis=1) / max(len(hand.tree.tips), 1)
    best = int(np.argmax(broad + FACED * into + PADS * pads + ABOVE * np.sign(tilt)))
    return [float(np.degrees(turn[best])), float(np.degrees(tilt[best]))]


def postures(hand: InspectedHand, met: Opposition | None) -> Json:
    """Return positions of the free joints for each posture button; radians or metres."""
    found = {"relaxed": rounded_list(hand.at_rest)}
    if hand.tree.robot.free_joints:
        lower, upper = hand.tree.joint_limits
        zero = np.clip(0.0, lower, upper)
        found |= {"zero": rounded_list(zero), "lower limits": rounded_list(lower), "upper limits": rounded_list(upper)}
    for meeting in () if met is None else (*met.pairs, *met.apart):
        found[posture_name(meeting.fingers)] = rounded_list(meeting.joints)
    return found


def posture_name(numbers: tuple[int, ...]) -> str:
    """Return the name of the posture in which given fingertips are nearest to each other."""
    return "tips " + " ".join(map(str, numbers))


def posture_button(name: str, text: str, pressed: bool = False) -> str:
    """Return a button that sets the joints to a posture."""
    return (
        f'<button type="button" data-posture="{escape(name)}" aria-pressed="{str(pressed).lower()}">'
        f"{escape(text)}</button>"
    )


def general_postures() -> str:
    """Return the buttons of the postures common to all hands."""
    named = "".join(posture_button(name, name.capitalize(), name == "relaxed") for name in GENERAL)
    return f'<div class="postures">{named}</div>'


def sliders(hand: InspectedHand) -> str:
    """Return the sliders of all free joints, by finger, with their mimic joints."""
    groups = "".join(_finger_sliders(hand, finger) for finger in fingers(hand.tree))
    if not groups:
        return '<aside class="sliders"><p class="note">No joint moves.</p></aside>'
    return f'<aside class="sliders" aria-label="Joints">{general_postures()}{groups}</aside>'


def _finger_sliders(hand: InspectedHand, finger: Finger) -> str:
    numbers = "".join(f'<span class="number">{i}</span>' for i in finger.tips)
    rows = "".join(_slider(hand, i) for i in finger.joints)
    return f"<fieldset><legend><h3>{numbers}<span>{escape(finger.name)}</span></h3></legend>{rows}</fieldset>"


def _slider(hand: InspectedHand, number: int) -> str:
    """Return the slider of a free joint, with the positions of its mimic joints."""
    robot = hand.tree.robot
    joint = robot.free_joints[number]
    lower, upper, _ = robot.ranges[joint.name]
    start = float(hand.at_rest[number])
    followers = "".join(
        f'<div class="follower"><span title="{escape(other.name)}">{escape(other.name)} follows</span>'
        f'<output data-joint="{i}"></output></div>'
        for i, other in enumerate(robot.joints)
        if other.moves and other.mimic is not None and robot.driving_joint(other)[0] == joint.name
    )
    name = escape(joint.name)
    ends = f"<i>{position_words(lower, joint.is_revolute)}</i><i>{position_words(upper, joint.is_revolute)}</i>"
    return (
        f'<div class="joint"><label for="joint{number}" title="{name}">{name}</label>'
        f'<output for="joint{number}">{position_words(start, joint.is_revolute)}</output>'
        f'<div class="track-of"><input id="joint{number}" type="range" data-driver="{number}" '
        f'min="{lower:.12g}" max="{upper:.12g}" step="any" value="{start:.12g}">'
        f'<span class="ends" aria-hidden="true">{ends}</span></div></div>{followers}'
    )


def position_words(position: float, turns: bool) -> str:
    """Return a joint's position as text: degrees, or millimetres."""
    number = float(np.degrees(position)) if turns else 1e3 * position
    text = format_number(round(number, 1 if abs(number) < ONE_DIGIT else 0), 8)
    return typeset(f"{text}°" if turns else f"{text} mm")


def hand_stage(hand: InspectedHand) -> str:
    """Return the scene with its switches, as HTML."""
    links, tips = len(hand.tree.robot.links), len(hand.tree.tips)
    aria = f"The hand with {links} links and {tips} fingertips; turn it with the mouse or the arrow keys."
    return f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>{switches(SWITCHES)}'


def viewer_data(hand: InspectedHand, met: Opposition | None, most: int) -> str:
    """Return the viewer's data as JSON for a script element.

    Parameters
    ----------
    hand : InspectedHand
    met : Opposition or None
        Opposition of the fingertips, for postures.
    most : int
        Approximate largest number of triangles of all links together.
    """
    found = {"tree": joint_tree(hand), "drawn": hand_scene(hand, most), "postures": postures(hand, met)}
    return json.dumps(found, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def describe_palm(hand: InspectedHand) -> str:
    """Return the palm's facing direction as text."""
    return f"palm faces {format_as_list(hand.tree.approach)} of link {hand.tree.robot.root}"
