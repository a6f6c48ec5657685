"""Forward kinematics of a robot as CasADi expressions, by adam-robotics."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec

import casadi as ca
import numpy as np

from nlpgrasp.common.types import Expression
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.hands.robot.robot import Joint, Robot

ROUNDING = 1e-15  # smaller constants of a rotation are zero


def require_kinematics() -> None:
    """Raise ``MissingExtraError`` when adam-robotics is not installed."""
    try:
        found = find_spec("adam.casadi")
    except ImportError:
        found = None
    if found is None:
        raise MissingExtraError("URDFHand", "hands")


def link_poses(robot: Robot, links: Iterable[str], joints: Expression) -> dict[str, Expression]:
    """Return the poses of links in the palm's frame, (4, 4) homogeneous transforms.

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
        driver, multiplier, offset = robot.follows(joint)
        values.append(multiplier * joints[index[driver]] + offset)
    model = KinDynComputations(_urdf(robot), [j.name for j in moving])
    everything = ca.vertcat(*values)
    poses = {name: model.forward_kinematics(name, np.eye(4), everything) for name in links if name != robot.root}
    poses[robot.root] = ca.SX.eye(4)
    return {name: ca.SX(ca.sparsify(pose, ROUNDING)) for name, pose in poses.items()}


def _urdf(robot: Robot) -> str:
    """Return a URDF with the robot's kinematics alone."""
    root = ET.Element("robot", name=robot.name)
    for link in robot.links:
        _link(root, link)
    for joint in robot.joints:
        if joint.kind == "prismatic":  # the library slides along the axis without the origin's rotation
            between = f"{joint.parent} to {joint.name}"
            _link(root, between)
            _joint(root, replace(joint, name=f"{joint.name} origin", kind="fixed", child=between))
            element = _joint(root, replace(joint, parent=between, xyz=np.zeros(3), rpy=np.zeros(3)))
        else:
            element = _joint(root, joint)
        ET.SubElement(element, "axis", xyz=_text(joint.axis))
        if joint.kind in ("revolute", "prismatic"):
            ET.SubElement(element, "limit", lower="-1", upper="1", effort="1", velocity="1")
    return ET.tostring(root, encoding="unicode")


def _link(root: ET.Element, name: str) -> None:
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")  # without mass it is no link
    ET.SubElement(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(inertial, "mass", value="1")
    ET.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")


def _joint(root: ET.Element, joint: Joint) -> ET.Element:
    element = ET.SubElement(root, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    ET.SubElement(element, "origin", xyz=_text(joint.xyz), rpy=_text(joint.rpy))
    return element


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


def rotation_of(quaternion: Expression) -> Expression:
    """Return the rotation matrix of a unit quaternion (w, x, y, z), as a polynomial."""
    w, x, y, z = (quaternion[i] for i in range(4))
    return ca.vertcat(
        ca.horzcat(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        ca.horzcat(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        ca.horzcat(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
