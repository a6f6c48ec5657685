"""3D scene of a hand with movable joints, with sliders and posture buttons."""

from __future__ import annotations

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
from nlpgrasp.report.page_builder import scene_html, switches
from nlpgrasp.report.scene_parts import AZIMUTHS, ELEVATIONS, frame_axes, surface, triangle_normals, view_directions

EXACT_DECIMALS = 12  # decimals of lengths in metres and of cosines
MOST_TRIANGLES, LEAST_TRIANGLES = 3000, 200  # triangles of a shape
HAND_TRIANGLES = 60_000  # most triangles of all shapes together
DISPLAY_DECIMALS = 7  # decimals of coordinates for display, metres
AXIS_LENGTH = 0.2  # length of the palm's axes, as a share of the hand's size
LEAF_RADIUS = 0.012  # share of the hand's size: mark of a possible fingertip
ABOVE_WEIGHT = 0.05  # weight of a view from above over one from below
PALM_WEIGHT = 0.35  # weight of a view into the palm, relative to the broadest view
PATCH_WEIGHT = 1.5  # weight of a view at the fingertips' patches
ONE_DIGIT = 100.0  # degrees or millimetres below which one decimal is shown
GENERAL_POSTURES = ("relaxed", "zero", "lower limits", "upper limits")
# visibility switches of the scene: group, label, initially shown
SWITCHES = (
    ("links", "Links", True),
    ("tips", "Fingertips", True),
    ("approach", "Palm direction", True),
    ("triad", "Palm axes", True),
    ("axes", "Joint axes", False),
)
VIEWER = ("shapes.js", "renderer.js", "view.js", "kinematics.js", "hand.js")


def joint_tree(hand: InspectedHand) -> Json:
    """Return the viewer's data of links, joints and the free joints that drive them.

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
    """Return the pose of a joint's frame in its parent link, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", joint.rpy).as_matrix(), joint.xyz
    return pose


def rounded_list(values: FloatArray, digits: int = EXACT_DECIMALS) -> list[float]:
    """Return an array as a list of rounded numbers, without -0."""
    return [float(v) + 0.0 for v in np.round(np.asarray(values, dtype=float), digits)]


def hand_scene(hand: InspectedHand, triangle_limit: int = HAND_TRIANGLES) -> Json:
    """Return the viewer's scene of a hand, in metres and each link's frame.

    Parameters
    ----------
    hand : InspectedHand
    triangle_limit : int
        Approximate largest number of triangles of all links together.

    Returns
    -------
    dict
        ``surfaces``: distinct surfaces. ``parts``: link number and surface. ``tips``: link number, name, surface,
        centre. ``leaves``: numbers of the links that may have a fingertip, if none are stated. ``corners``: link number
        and corners of its shapes' bounding box, for framing. ``approach``: origin and unit direction, palm frame.
        ``axes``: of the palm's frame. ``size``, ``dot``: of the hand and of a leaf's mark. ``view``: azimuth and
        elevation of the camera, degrees.
    """
    links = hand.tree.robot.links
    index = {name: i for i, name in enumerate(links)}
    surfaces = _DistinctSurfaces()
    parts, corners = _link_parts(hand, surfaces, triangle_limit)
    tips, tip_corners = _tip_parts(hand, surfaces)
    leaves = [] if tips else [index[link] for link in hand.leaf_links]
    corners += [*tip_corners, *({"link": i, "at": [[0.0, 0.0, 0.0]]} for i in leaves)]
    if not corners:
        corners = [{"link": i, "at": [[0.0, 0.0, 0.0]]} for i in range(len(links))]
    points = _link_corners(hand, corners)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-3)
    return {
        "surfaces": surfaces.data,
        "parts": parts,
        "tips": tips,
        "leaves": leaves,
        "corners": corners,
        "approach": {"at": _palm_origin(hand), "along": rounded_list(hand.tree.approach)},
        "axes": frame_axes(np.zeros(3), np.full(3, AXIS_LENGTH * size)),
        "size": size,
        "dot": LEAF_RADIUS * size,
        "view": _hand_view(points, hand),
    }


class _DistinctSurfaces:
    """Surfaces of a scene without duplicates."""

    def __init__(self) -> None:
        self.data: list[Json] = []
        self._index_of_key: dict[bytes, int] = {}

    def index(self, key: bytes, shape: Triangles) -> int:
        """Return the index of the surface with this key, and store the surface if the key is new."""
        if key not in self._index_of_key:
            self._index_of_key[key] = len(self.data)
            self.data.append(surface(shape).to_dict())
        return self._index_of_key[key]


def _link_parts(hand: InspectedHand, surfaces: _DistinctSurfaces, triangle_limit: int) -> tuple[list[Json], list[Json]]:
    """Return the viewer's data of the links' shapes, and the corners of their bounding boxes.

    The shapes have about ``triangle_limit`` triangles at most.
    """
    robot = hand.tree.robot
    parts: list[Json] = []
    corners: list[Json] = []
    shape_count = max(1, sum(map(len, robot.shapes.values())))
    triangles_per_shape = max(LEAST_TRIANGLES, min(MOST_TRIANGLES, triangle_limit // shape_count))
    link_index = {name: i for i, name in enumerate(robot.links)}
    for link, shapes in robot.shapes.items():
        for shape in shapes:
            vertices, faces = np.asarray(shape.mesh.vertices, dtype=float), np.asarray(shape.mesh.faces)
            simplified = Triangles(*simplify(vertices, faces, triangles_per_shape))
            parts.append({"link": link_index[link], "surface": surfaces.index(shape.fingerprint, simplified)})
            corners.append({"link": link_index[link], "at": _box_corners(vertices)})
    return parts, corners


def _tip_parts(hand: InspectedHand, surfaces: _DistinctSurfaces) -> tuple[list[Json], list[Json]]:
    """Return the viewer's data of the fingertips' patches, and the corners of their bounding boxes."""
    parts: list[Json] = []
    corners: list[Json] = []
    link_index = {name: i for i, name in enumerate(hand.tree.robot.links)}
    for link, tip in hand.tree.tips:
        shape = tip.surface()
        surface_index = surfaces.index(shape.vertices.round(9).tobytes(), shape)
        centre = rounded_list(tip.backbone.mean(axis=0), DISPLAY_DECIMALS)
        entry = {"link": link_index[link], "name": link, "surface": surface_index, "at": centre, "radius": tip.standoff}
        parts.append(entry)
        corners.append({"link": link_index[link], "at": _box_corners(shape.vertices)})
    return parts, corners


def _box_corners(vertices: FloatArray) -> list[list[float]]:
    """Return the corners of the bounding box of points."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    return [rounded_list(corner, DISPLAY_DECIMALS) for corner in corners]


def _palm_origin(hand: InspectedHand) -> list[float]:
    """Return the point at which the arrow of the palm's direction starts.

    This is the front of the palm's shapes, or the palm's origin if there are none.
    """
    shapes = hand.tree.robot.shapes.get(hand.tree.robot.root, ())
    if not shapes:
        return [0.0, 0.0, 0.0]
    vertices = np.concatenate([np.asarray(shape.mesh.vertices, dtype=float) for shape in shapes])
    middle, along = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0, hand.tree.approach
    return rounded_list(middle + np.max((vertices - middle) @ along) * along, DISPLAY_DECIMALS)


def _relaxed_link_poses(hand: InspectedHand) -> dict[str, FloatArray]:
    """Return the pose (4, 4) in the palm frame of each used link, in the relaxed posture."""
    names = hand.tree.used_links
    return dict(zip(names, hand.tree.palm_poses(hand.rest_posture[None])[0], strict=True)) if names else {}


def _link_corners(hand: InspectedHand, corners: Sequence[Json]) -> FloatArray:
    """Return the palm's origin and the corners of used links, (n, 3), in the palm's frame."""
    poses, links = _relaxed_link_poses(hand), hand.tree.robot.links
    points = [np.zeros((1, 3))]
    for entry in corners:
        pose = poses.get(links[int(entry["link"])])
        if pose is not None:
            points.append(np.asarray(entry["at"]) @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(points)


def _patch_normals(hand: InspectedHand) -> FloatArray:
    """Return the mean outward normal of each fingertip's patch, (k, 3), palm frame.

    The mean of a ball is zero.
    """
    poses, means = _relaxed_link_poses(hand), [np.zeros((0, 3))]
    for link, tip in hand.tree.tips:
        shape = tip.surface()
        corners = shape.vertices[shape.faces]
        areas = triangle_normals(corners)
        mean = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        means.append((poses[link][:3, :3] @ mean)[None])
    return np.concatenate(means)


def _hand_view(points: FloatArray, hand: InspectedHand) -> list[float]:
    """Return azimuth and elevation, degrees, of the initial view of a hand.

    The view is at the hand's broad side, into the palm and onto flat fingertips.
    """
    azimuth, elevation = (x.ravel() for x in np.meshgrid(AZIMUTHS, [*ELEVATIONS, *-ELEVATIONS], indexing="ij"))
    eyes = view_directions(azimuth, elevation)
    centred = points - points.mean(axis=0)
    total = float(np.sum(centred**2)) or 1.0
    breadth = 1.0 - np.sum((centred @ eyes.T) ** 2, axis=0) / total
    palm_view = np.clip(eyes @ hand.tree.approach, None, 0.8)
    pads = np.clip(eyes @ _patch_normals(hand).T, 0.0, 0.5).sum(axis=1) / max(len(hand.tree.tips), 1)
    best = int(np.argmax(breadth + PALM_WEIGHT * palm_view + PATCH_WEIGHT * pads + ABOVE_WEIGHT * np.sign(elevation)))
    return [float(np.degrees(azimuth[best])), float(np.degrees(elevation[best]))]


def postures(hand: InspectedHand, opposition: Opposition | None) -> Json:
    """Return the positions of the free joints for each posture button, radians or metres."""
    positions = {"relaxed": rounded_list(hand.rest_posture)}
    if hand.tree.robot.free_joints:
        lower, upper = hand.tree.joint_limits
        zero = np.clip(0.0, lower, upper)
        positions |= {
            "zero": rounded_list(hand.tree.close(zero)),
            "lower limits": rounded_list(hand.tree.close(lower)),
            "upper limits": rounded_list(hand.tree.close(upper)),
        }
    for meeting in () if opposition is None else (*opposition.pairs, *opposition.separated):
        positions[posture_name(meeting.fingers)] = rounded_list(meeting.joints)
    return positions


def posture_name(tips: tuple[int, ...]) -> str:
    """Return the name of the posture in which the given fingertips are nearest to each other."""
    return "tips " + " ".join(map(str, tips))


def posture_button(name: str, text: str, pressed: bool = False) -> str:
    """Return a button that sets the joints to a posture, as HTML."""
    return (
        f'<button type="button" data-posture="{escape(name)}" aria-pressed="{str(pressed).lower()}">'
        f"{escape(text)}</button>"
    )


def general_postures() -> str:
    """Return the buttons of the postures common to all hands, as HTML."""
    buttons = "".join(posture_button(name, name.capitalize(), name == "relaxed") for name in GENERAL_POSTURES)
    return f'<div class="postures">{buttons}</div>'


def sliders(hand: InspectedHand) -> str:
    """Return the sliders of all free joints as HTML, by finger."""
    groups = "".join(_finger_sliders(hand, finger) for finger in fingers(hand.tree))
    if not groups:
        return '<aside class="sliders"><p class="note">No joint moves.</p></aside>'
    return f'<aside class="sliders" aria-label="Joints">{general_postures()}{groups}</aside>'


def _finger_sliders(hand: InspectedHand, finger: Finger) -> str:
    """Return a finger's joint sliders as HTML."""
    tip_marks = "".join(f'<span class="number">{i}</span>' for i in finger.tips)
    rows = "".join(_joint_slider(hand, i) for i in finger.joints)
    return f"<fieldset><legend><h3>{tip_marks}<span>{escape(finger.name)}</span></h3></legend>{rows}</fieldset>"


def _joint_slider(hand: InspectedHand, index: int) -> str:
    """Return the slider of a free joint as HTML, with the positions of its mimic joints."""
    robot = hand.tree.robot
    joint = robot.free_joints[index]
    lower, upper, _ = robot.ranges[joint.name]
    start = float(hand.rest_posture[index])
    followers = "".join(
        f'<div class="follower"><span title="{escape(follower.name)}">{escape(follower.name)} follows</span>'
        f'<output data-joint="{i}"></output></div>'
        for i, follower in enumerate(robot.joints)
        if follower.moves and follower.mimic is not None and robot.driving_joint(follower)[0] == joint.name
    )
    name = escape(joint.name)
    ends = f"<i>{format_position(lower, joint.is_revolute)}</i><i>{format_position(upper, joint.is_revolute)}</i>"
    return (
        f'<div class="joint"><label for="joint{index}" title="{name}">{name}</label>'
        f'<output for="joint{index}">{format_position(start, joint.is_revolute)}</output>'
        f'<div class="track-of"><input id="joint{index}" type="range" data-driver="{index}" '
        f'min="{lower:.12g}" max="{upper:.12g}" step="any" value="{start:.12g}">'
        f'<span class="ends" aria-hidden="true">{ends}</span></div></div>{followers}'
    )


def format_position(position: float, is_revolute: bool) -> str:
    """Return a joint's position as text, in degrees or millimetres."""
    value = float(np.degrees(position)) if is_revolute else 1e3 * position
    text = format_number(round(value, 1 if abs(value) < ONE_DIGIT else 0), 8)
    return typeset(f"{text}°" if is_revolute else f"{text} mm")


def hand_scene_html(hand: InspectedHand, more: str) -> str:
    """Return a hand's scene with visibility switches as HTML.

    ``more`` is HTML below the switches.
    """
    links, tips = len(hand.tree.robot.links), len(hand.tree.tips)
    description = f"The hand with {links} links and {tips} fingertips"
    return scene_html(description, [switches(SWITCHES), more], means="the mouse")


def viewer_data(hand: InspectedHand, opposition: Opposition | None, triangle_limit: int) -> Json:
    """Return the viewer's data of a hand: joints, scene and postures.

    Parameters
    ----------
    hand : InspectedHand
    opposition : Opposition or None
        Opposition of the fingertips, for postures.
    triangle_limit : int
        Approximate largest number of triangles of all links together.
    """
    return {"tree": joint_tree(hand), "drawn": hand_scene(hand, triangle_limit), "postures": postures(hand, opposition)}


def describe_palm(hand: InspectedHand) -> str:
    """Return the direction that the palm faces, as text."""
    return f"palm faces {format_as_list(hand.tree.approach)} of link {hand.tree.robot.root}"
