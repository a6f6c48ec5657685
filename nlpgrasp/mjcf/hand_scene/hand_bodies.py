"""MJCF links, joints and actuators of a robot hand."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.spheres.shapes import Shape
from nlpgrasp.hands.urdf.inertials import Inertial
from nlpgrasp.mjcf.hand_scene.options import ARM_STIFFNESS, HandSceneOptions
from nlpgrasp.mjcf.hand_scene.tip_geoms import quaternion, tip_geom
from nlpgrasp.mjcf.parts import numbers
from nlpgrasp.solution.squeezed.joints import LEVER

PREFIX = "hand_"
ARM = ("palm_x", "palm_y", "palm_z")  # sliding joints that carry the palm, along the axes of the body frame
LEAST_MASS, LEAST_MOMENT = 1e-3, 1e-7  # kg and kg m^2, least mass and moment of a link, as MuJoCo requires
ARMATURE = {True: 1e-3, False: 0.1}  # armature of revolute joints, kg m^2, and of prismatic ones, kg
LOOK = {"rgba": "0.71 0.61 0.48 1"}
# hand and object collide, links of the hand do not: the NLP excludes self-collision by spheres
TOUCHES = {"contype": "1", "conaffinity": "0"}


@dataclass(frozen=True)
class PlacedRobot:
    """A robot hand placed at its palm pose in the grasp.

    Parameters
    ----------
    robot : Robot
    inertials : mapping of str to Inertial
        Of the links that state them.
    palm : mapping
        ``position`` and ``quaternion_wxyz`` of the palm in the grasp, body frame.
    tips : sequence of mappings
        Fingertips as JSON data, with their ``link``.
    gains : mapping of str to float
        Of the joints' position control, by free joint.
    limits : mapping of str to float
        Torque limits by joint.
    floating : collection of int
        Fingertips that are off their links in the grasp: the scene has only the links' own shapes there.
    """

    robot: Robot
    inertials: Mapping[str, Inertial]
    palm: Json
    tips: tuple[Json, ...]
    gains: Mapping[str, float]
    limits: Mapping[str, float]
    floating: Collection[int] = ()


def add_hand(root: Element, placed: PlacedRobot, surfaces: list[dict[str, str]], options: HandSceneOptions) -> None:
    """Add the hand to a scene: three sliding joints that carry the palm, links, actuators, mimic joints.

    Parameters
    ----------
    root : Element
        Of the scene, with ``asset`` and ``worldbody``.
    placed : PlacedRobot
    surfaces : list of mappings
        Attributes of each fingertip's geoms: friction of its contact model.
    options : HandSceneOptions
    """
    asset, world = root.find("asset"), root.find("worldbody")
    if asset is None or world is None:
        raise ValueError("a scene has an asset and a worldbody")
    robot = placed.robot
    carried = SubElement(world, "body", name="hand", pos=numbers(placed.palm["position"]), gravcomp="1")
    weight = sum(placed.inertials[link].mass for link in robot.links if link in placed.inertials) or 1.0
    critical = 2.0 * np.sqrt(ARM_STIFFNESS * 2.0 * weight)  # of an arm as heavy as the hand that it carries
    for name, axis in zip(ARM, np.eye(3), strict=True):
        SubElement(carried, "joint", name=name, type="slide", axis=numbers(axis), damping=f"{critical:.9g}")
    SubElement(carried, "inertial", pos="0 0 0", mass=f"{weight:.9g}", diaginertia=numbers([weight * 1e-3] * 3))
    bodies: dict[str, Element] = {}
    above = {joint.child: joint for joint in robot.joints}
    own = {str(tip["link"]): surface for tip, surface in zip(placed.tips, surfaces, strict=True)}
    for i in placed.floating:
        group = robot.rigid_groups[str(placed.tips[i]["link"])]
        for link in (link for link in robot.links if robot.rigid_groups[link] == group):
            own.setdefault(link, surfaces[i])
    for link in robot.links:
        joint = above.get(link)
        parent = carried if joint is None else bodies[joint.parent]
        pose = {"quat": numbers(placed.palm["quaternion_wxyz"])} if joint is None else _pose(joint)
        body = SubElement(parent, "body", {"name": PREFIX + link, "gravcomp": "1", **pose})
        bodies[link] = body
        if joint is not None and joint.moves:
            _add_joint(body, joint, options)
        _add_inertial(body, placed.inertials.get(link))
        for i, shape in enumerate(robot.shapes.get(link, ())):
            _add_shape(asset, body, f"{PREFIX}{link}_{i}", shape, own.get(link, {}))
    for i, (tip, surface) in enumerate(zip(placed.tips, surfaces, strict=True)):
        geom = tip_geom(tip)
        if geom is not None and i not in placed.floating:
            name = f"fingertip_{i}"
            SubElement(bodies[str(tip["link"])], "geom", {"name": name, "mass": "0", **geom, **TOUCHES, **surface})
    _add_actuators(root, placed)


def _pose(joint: Joint) -> dict[str, str]:
    turn = Rotation.from_euler("xyz", joint.rpy).as_matrix()
    return {"pos": numbers(joint.xyz), "quat": quaternion(turn)}


def _add_joint(body: Element, joint: Joint, options: HandSceneOptions) -> None:
    arm = 1.0 if joint.turns else LEVER  # a prismatic joint counts as a revolute one on such a lever
    given = {
        "name": PREFIX + joint.name,
        "type": "hinge" if joint.turns else "slide",
        "axis": numbers(joint.axis),
        "damping": f"{options.damping / arm**2:.9g}",
        "frictionloss": f"{options.frictionloss / arm:.9g}",
        "armature": f"{ARMATURE[joint.turns]:.9g}",
    }
    limited = joint.kind != "continuous" and np.isfinite(joint.lower) and joint.lower < joint.upper
    SubElement(body, "joint", {**given, "range": numbers([joint.lower, joint.upper])} if limited else given)


def _add_inertial(body: Element, stated: Inertial | None) -> None:
    """Add mass and inertia of a link, at least the smallest that MuJoCo accepts."""
    mass = LEAST_MASS if stated is None else max(stated.mass, LEAST_MASS)
    center = np.zeros(3) if stated is None else stated.center
    moments, axes = np.linalg.eigh(np.zeros((3, 3)) if stated is None else stated.inertia)
    tensor = axes @ np.diag(np.maximum(moments, LEAST_MOMENT)) @ axes.T
    full = numbers(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    SubElement(body, "inertial", pos=numbers(center), mass=f"{mass:.9g}", fullinertia=full)


def _add_shape(asset: Element, body: Element, name: str, shape: Shape, surface: dict[str, str]) -> None:
    """Add a collision shape: a MuJoCo primitive if possible, else the convex hull of its mesh."""
    geom = {"name": name, **LOOK, **TOUCHES, **surface}
    if shape.centre is not None:
        geom |= {"type": "sphere", "size": numbers([shape.radius]), "pos": numbers(shape.centre)}
    elif shape.pose is not None:
        half = [shape.size[0], shape.size[1] / 2.0] if shape.kind != "box" else [s / 2.0 for s in shape.size]
        place = {"pos": numbers(shape.pose[:3, 3]), "quat": quaternion(shape.pose[:3, :3])}
        geom |= {"type": shape.kind, "size": numbers(half), **place}
    else:
        hull: FloatArray = np.asarray(shape.mesh.convex_hull.vertices)
        SubElement(asset, "mesh", name=name, vertex=numbers(hull.ravel()))
        geom |= {"type": "mesh", "mesh": name}
    SubElement(body, "geom", geom)


def _add_actuators(root: Element, placed: PlacedRobot) -> None:
    """Add position servos for free joints and the arm, and equality constraints for mimic joints."""
    actuator, equality = SubElement(root, "actuator"), SubElement(root, "equality")
    for name in ARM:
        _add_servo(actuator, name, ARM_STIFFNESS, None)
    for joint in placed.robot.free_joints:
        _add_servo(actuator, PREFIX + joint.name, placed.gains[joint.name], placed.limits.get(joint.name))
    for joint in placed.robot.joints:
        if joint.moves and joint.mimic is not None:
            driver, multiplier, offset = placed.robot.follows(joint)
            names = {"joint1": PREFIX + joint.name, "joint2": PREFIX + driver}
            SubElement(equality, "joint", {**names, "polycoef": numbers([offset, multiplier, 0.0, 0.0, 0.0])})


def _add_servo(actuator: Element, joint: str, gain: float, limit: float | None) -> None:
    given = {"name": joint, "joint": joint, "kp": f"{gain:.9g}"}
    bounded = {} if limit is None else {"forcerange": numbers([-limit, limit])}
    SubElement(actuator, "position", {**given, **bounded})
