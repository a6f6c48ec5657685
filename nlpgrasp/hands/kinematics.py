"""Forward kinematics and contact Jacobians of a robot hand, as CasADi expressions and numbers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from importlib.util import find_spec

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.scalar_constraints import PalmPose
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.hands.closed_linkages import ClosedLinkages, random_joints
from nlpgrasp.hands.moving_links import MovingLinks
from nlpgrasp.hands.robot import Joint, Robot
from nlpgrasp.hands.tips import Tip

ROUNDING = 1e-15  # smaller constants of a rotation are zero
# attributes that hold CasADi functions
COMPILED = ("_link_functions", "contact_function", "linkages")
DRAWN_SHARES = (0.1, 0.7)  # part of the joint ranges, as shares, from which random postures are drawn


class LinkTree:
    """Kinematic tree of the links that have a fingertip or a collision shape.

    Parameters
    ----------
    robot : Robot
    tips : sequence of (str, Tip)
        Link and patch of each contact.
    approach : (3,) array
        Unit direction in which the palm faces, palm frame.
    """

    def __init__(self, robot: Robot, tips: Sequence[tuple[str, Tip]], approach: FloatArray) -> None:
        self.robot = robot
        self.tips = tuple(tips)
        self.approach = approach

    @cached_property
    def joint_limits(self) -> FloatArray:
        """Lower and upper limits of the free joints, (2, m), tightened by the limits of mimic joints."""
        return np.array([ends[:2] for ends in self.robot.ranges.values()], dtype=float).T

    def with_limits(self, limits: FloatArray) -> LinkTree:
        """Return the same tree with other limits of the free joints, (2, m)."""
        result = copy(self)
        result.__dict__.pop("linkages", None)
        result.joint_limits = limits
        return result

    @cached_property
    def linkages(self) -> ClosedLinkages:
        """Equations that the free joints keep."""
        return ClosedLinkages(self.robot, self.joint_limits)

    def random_joints(
        self, count: int, rng: np.random.Generator, shares: tuple[float, float] = (0.0, 1.0)
    ) -> FloatArray:
        """Return random positions of the free joints, (count, m), from a part of their ranges; linkages are closed."""
        linkages = self.linkages if self.robot.has_linkages else None
        return random_joints(self.robot, self.joint_limits, count, rng, shares, linkages)

    def close(self, joints: FloatArray) -> FloatArray:
        """Return positions of the free joints, (..., m), moved so that linkages are closed."""
        if not self.robot.has_linkages:
            return joints
        return self.linkages.close(np.atleast_2d(joints)).reshape(np.shape(joints))

    def joint_positions(self, joints: FloatArray) -> dict[str, float]:
        """Return the position of every moving joint by name, given the positions of the free joints (m,).

        Joints that springs hold at a limit are included.
        """
        index = {j.name: i for i, j in enumerate(self.robot.free_joints)}
        result = {}
        for joint in self.robot.joints:
            if joint.moves:
                driver, multiplier, offset = self.robot.driving_joint(joint)
                result[joint.name] = float(multiplier * joints[index[driver]] + offset)
        return result | self.robot.stop_positions

    def palm(self, variables: dict[str, Expression]) -> PalmPose:
        """Return the palm's pose in the body frame (symbolic)."""
        rotation = rotation_matrix(variables["palm_quaternion"])
        return PalmPose(variables["palm_position"], rotation, ca.mtimes(rotation, ca.DM(self.approach)))

    def poses(self, variables: dict[str, Expression], links: tuple[str, ...] | None = None) -> dict[str, Expression]:
        """Return the poses of links, of those of the fingertips if none are named, in the body frame (symbolic)."""
        palm, links = self.palm(variables), self.tip_links if links is None else links
        base = ca.vertcat(ca.horzcat(palm.rotation, palm.position), ca.SX([[0.0, 0.0, 0.0, 1.0]]))
        poses = ca.horzsplit(self._link_function(links)(variables["joints"]), 4)
        return {name: ca.mtimes(base, pose) for name, pose in zip(links, poses, strict=True)}

    def palm_frame(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return the palm's pose in the body frame, (4, 4), given values of the hand's variables."""
        frame = np.eye(4)
        frame[:3, :3] = Rotation.from_quat(values["palm_quaternion"], scalar_first=True).as_matrix()
        frame[:3, 3] = values["palm_position"]
        return frame

    def palm_poses(self, joints: FloatArray) -> FloatArray:
        """Return the used links' poses in the palm frame, (b, links, 4, 4), at positions (b, m) of the free joints."""
        return self.moving_links.palm_frames(joints).of_links(self.used_links)

    @cached_property
    def moving_links(self) -> MovingLinks:
        """Frames of the robot's groups of links in many postures."""
        return MovingLinks(self.robot)

    def body_poses(self, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the used links' poses in the body frame, (4, 4) each, given values of the hand's variables."""
        base = self.palm_frame(values)
        poses = self.palm_poses(np.asarray(values["joints"], dtype=float)[None])[0]
        return {name: base @ pose for name, pose in zip(self.used_links, poses, strict=True)}

    def tips_with_slides(self, variables: dict[str, Expression]) -> list[tuple[str, Tip, Expression]]:
        """Return link, patch and sliding coordinate of each fingertip; patches without a coordinate have None."""
        slides = iter(ca.vertsplit(variables["slides"])) if "slides" in variables else iter(())
        return [(link, tip, next(slides) if tip.slides else None) for link, tip in self.tips]

    def tip_centres(self, variables: dict[str, Expression]) -> list[Expression | None]:
        """Return the centre of each round fingertip in the body frame; None for other fingertips."""
        poses = self.poses(variables)
        return [tip.ball_centre(poses[link], slide) for link, tip, slide in self.tips_with_slides(variables)]

    def tip_places(self, variables: dict[str, Expression]) -> list[Expression]:
        """Return the middle of each fingertip in the body frame."""
        poses = self.poses(variables)
        tips = zip(self.tips, self.tip_centres(variables), strict=True)
        return [
            poses[link][:3, 3] + ca.mtimes(poses[link][:3, :3], ca.DM(tip.centre)) if centre is None else centre
            for (link, tip), centre in tips
        ]

    def rigid_transform(self, link: str, other: str) -> FloatArray | None:
        """Return the transform (4, 4) from one link's frame to another's if they are rigidly connected, else None."""
        groups = self.robot.rigid_groups
        if groups[link] != groups[other]:
            return None
        poses = self.palm_poses(np.zeros((1, len(self.robot.free_joints))))[0]
        a, b = (poses[self.used_links.index(name)] for name in (link, other))
        return np.asarray(np.linalg.inv(b) @ a)

    @cached_property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the free joints that move a contact; of a hand with closed linkages, of all free joints."""
        if self.robot.has_linkages:
            return tuple(j.name for j in self.robot.free_joints)
        moving = [joint for link, _ in self.tips for joint in self.robot.chain(link) if joint.moves]
        drivers = {self.robot.driving_joint(joint)[0] for joint in moving}
        return tuple(j.name for j in self.robot.free_joints if j.name in drivers)

    def contact_motion(
        self, variables: dict[str, Expression], rates: Expression, points: Sequence[Expression]
    ) -> list[tuple[Expression, Expression]]:
        """Return velocity and angular velocity, (3,) each, body frame, of contact points that are fixed to their links.

        Arguments are those of ``PosedHand.contact_motion``.
        """
        palm, q = self.palm(variables), variables["joints"]
        joint_rates = ca.SX(len(self.robot.free_joints), 1)
        for j, joint in enumerate(self.robot.free_joints):
            if joint.name in self.loaded_joints:
                joint_rates[j] = rates[self.loaded_joints.index(joint.name)]
        stacked = self._link_function(self.tip_links)(q)
        poses, pose_rates = (ca.horzsplit(m, 4) for m in (stacked, ca.jtimes(stacked, q, joint_rates)))
        result = []
        for (link, _), point in zip(self.tips, points, strict=True):
            index = self.tip_links.index(link)
            pose, pose_rate = poses[index], pose_rates[index]
            local = ca.mtimes(pose[:3, :3].T, ca.mtimes(palm.rotation.T, point - palm.position) - pose[:3, 3])
            spin = ca.mtimes(pose_rate[:3, :3], pose[:3, :3].T)
            velocity = ca.mtimes(pose_rate[:3, :3], local) + pose_rate[:3, 3]
            angular = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
            result.append((ca.mtimes(palm.rotation, velocity), ca.mtimes(palm.rotation, angular)))
        return result

    @cached_property
    def contact_function(self) -> ca.Function:
        """CasADi function to the stacked contact Jacobians (6 k, m).

        Its arguments are palm position, quaternion, joint positions and contact points (3, k).
        """
        variables = {"palm_position": ca.SX.sym("t", 3), "palm_quaternion": ca.SX.sym("r", 4)}
        variables["joints"] = ca.SX.sym("q", len(self.robot.free_joints))
        rates, points = ca.SX.sym("rates", len(self.loaded_joints)), ca.SX.sym("p", 3, len(self.tips))
        motion = self.contact_motion(variables, rates, ca.horzsplit(points))
        velocities = ca.vertcat(*[part for pair in motion for part in pair])
        return ca.Function("contacts", [*variables.values(), points], [ca.jacobian(velocities, rates)], {"cse": True})

    @cached_property
    def span(self) -> float:
        """Largest distance of a fingertip from the palm's origin, metres, over 500 random postures."""
        tips = self.palm_tips(self.random_joints(500, np.random.default_rng(0)))
        return float(np.max(np.linalg.norm(tips, axis=2)))

    def palm_tips(self, joints: FloatArray) -> FloatArray:
        """Return the fingertip centres (b, k, 3) in the palm frame at joint positions (b, m)."""
        centres = np.array([tip.centre for _, tip in self.tips], dtype=float).reshape(-1, 3)
        at, groups = self.moving_links.in_groups([link for link, _ in self.tips], centres)
        return self.moving_links.palm_frames(joints).points(at, groups)

    def draw(
        self, count: int, around: FloatArray, rng: np.random.Generator
    ) -> tuple[dict[str, FloatArray], FloatArray]:
        """Return random palm poses and joint positions, (count, m) each, and the fingertip centres, (count, k, 3).

        The fingertips' centroid is at the given points, (count, 3).
        """
        joints = self.random_joints(count, rng, DRAWN_SHARES)
        rotations = Rotation.random(count, rng=rng)
        tips = np.einsum("bij,bkj->bki", rotations.as_matrix(), self.palm_tips(joints))
        position = around - tips.mean(axis=1)
        quaternion = rotations.as_quat(scalar_first=True)
        values = {"palm_position": position, "palm_quaternion": quaternion, "joints": joints}
        return values | self.initial_slides(count), position[:, None] + tips

    def initial_slides(self, count: int) -> dict[str, FloatArray]:
        """Return the initial sliding coordinates of the fingertips, (count, m)."""
        slides = [tip.initial_slide for _, tip in self.tips if tip.slides]
        return {"slides": np.tile(slides, (count, 1))} if slides else {}

    @cached_property
    def used_links(self) -> tuple[str, ...]:
        """Links whose poses are computed, parents first."""
        used = {link for link, _ in self.tips} | set(self.robot.shapes)
        return tuple(link for link in self.robot.links if link in used)

    @cached_property
    def tip_links(self) -> tuple[str, ...]:
        """Links with a fingertip, parents first."""
        return tuple(link for link in self.robot.links if link in dict(self.tips))

    @cached_property
    def _link_functions(self) -> dict[tuple[str, ...], ca.Function]:
        return {}

    def _link_function(self, links: tuple[str, ...]) -> ca.Function:
        """Return the CasADi function from joint positions to poses of links in the palm frame, side by side."""
        if links not in self._link_functions:
            q = ca.SX.sym("q", len(self.robot.free_joints))
            poses = link_poses(self.robot, links, q)
            stacked = ca.horzcat(*[poses[name] for name in links])
            self._link_functions[links] = ca.Function("links", [q], [stacked], {"cse": True})
        return self._link_functions[links]

    def __getstate__(self) -> dict[str, object]:
        """Keep the defining fields; compiled functions are rebuilt after unpickling."""
        return {k: v for k, v in self.__dict__.items() if k not in COMPILED}


def rotation_matrix(quaternion: Expression) -> Expression:
    """Return the rotation matrix of a unit quaternion (w, x, y, z), as a polynomial."""
    w, x, y, z = (quaternion[i] for i in range(4))
    return ca.vertcat(
        ca.horzcat(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        ca.horzcat(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        ca.horzcat(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def link_poses(robot: Robot, links: Iterable[str], joints: Expression) -> dict[str, Expression]:
    """Return the poses of links in the palm frame, homogeneous transforms (4, 4).

    The library gets the robot below the palm alone, with unit axes and without mimic joints: it supports
    neither default axes nor mimic joints.

    Parameters
    ----------
    robot : Robot
    links : iterable of str
    joints : casadi.SX
        Values of ``robot.free_joints``, radians or metres.

    Raises
    ------
    MissingExtraError
        When adam-robotics is not installed.
    """
    require_kinematics()
    from adam.casadi import KinDynComputations

    moving = [j for j in robot.joints if j.moves]
    index = {j.name: i for i, j in enumerate(robot.free_joints)}
    values = []
    for joint in moving:
        driver, multiplier, offset = robot.driving_joint(joint)
        values.append(multiplier * joints[index[driver]] + offset)
    model = KinDynComputations(_kinematic_urdf(robot), [j.name for j in moving])
    positions = ca.vertcat(*values)
    poses = {name: model.forward_kinematics(name, np.eye(4), positions) for name in links if name != robot.root}
    poses[robot.root] = ca.SX.eye(4)
    return {name: ca.SX(ca.sparsify(pose, ROUNDING)) for name, pose in poses.items()}


def require_kinematics() -> None:
    """Raise ``MissingExtraError`` when adam-robotics is not installed."""
    try:
        spec = find_spec("adam.casadi")
    except ImportError:
        spec = None
    if spec is None:
        raise MissingExtraError("URDFHand", "hands")


def _kinematic_urdf(robot: Robot) -> str:
    """Return a URDF with the robot's links and joints alone."""
    root = ET.Element("robot", name=robot.name)
    for link in robot.links:
        _add_link_element(root, link)
    for joint in robot.joints:
        if joint.kind == "prismatic":  # the library slides along the axis without the origin's rotation
            between = f"{joint.parent} to {joint.name}"
            _add_link_element(root, between)
            _joint_element(root, replace(joint, name=f"{joint.name} origin", kind="fixed", child=between))
            element = _joint_element(root, replace(joint, parent=between, xyz=np.zeros(3), rpy=np.zeros(3)))
        else:
            element = _joint_element(root, joint)
        ET.SubElement(element, "axis", xyz=_format_numbers(joint.axis))
        if joint.kind in ("revolute", "prismatic"):
            ET.SubElement(element, "limit", lower="-1", upper="1", effort="1", velocity="1")  # required, unused
    return ET.tostring(root, encoding="unicode")


def _add_link_element(root: ET.Element, name: str) -> None:
    """Add a link element to a URDF."""
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")  # without mass it is no link
    ET.SubElement(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(inertial, "mass", value="1")
    ET.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")


def _joint_element(root: ET.Element, joint: Joint) -> ET.Element:
    """Add a joint element to a URDF and return it."""
    element = ET.SubElement(root, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    ET.SubElement(element, "origin", xyz=_format_numbers(joint.xyz), rpy=_format_numbers(joint.rpy))
    return element


def _format_numbers(values: Iterable[float]) -> str:
    """Return numbers as text with all digits, separated by spaces."""
    return " ".join(repr(float(v)) for v in values)
