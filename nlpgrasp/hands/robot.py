"""Robot description as plain data: links, joints, collision shapes and masses, with validity checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.robot_files import SI, UrdfUnits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.collision_shapes import CollisionShape

MOVABLE = ("revolute", "continuous", "prismatic")  # kinds of joints that move


@dataclass(frozen=True)
class Mimic:
    """Mimic relation of a joint to another joint: ``value = multiplier * other + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    Parameters
    ----------
    name, kind, parent, child : str
        ``kind`` is one of revolute, continuous, prismatic, fixed.
    xyz, rpy : (3,) array
        Pose of the child's frame in the parent's, metres and radians.
    axis : (3,) array
        Unit, in the joint's frame.
    lower, upper : float
        Limits, radians or metres.
    effort : float or None
        Greatest torque (force of a sliding joint), newton-metres or newtons.
    mimic : Mimic or None
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: FloatArray
    rpy: FloatArray
    axis: FloatArray
    lower: float
    upper: float
    effort: float | None = None
    mimic: Mimic | None = None

    @property
    def is_revolute(self) -> bool:
        """Whether the joint's position is an angle."""
        return self.kind != "prismatic"

    @property
    def moves(self) -> bool:
        """Whether the joint is movable, not fixed."""
        return self.kind in MOVABLE

    @property
    def frame(self) -> FloatArray:
        """Pose (4, 4) of the child link's frame in the parent's at joint position zero."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix()
        pose[:3, 3] = self.xyz
        return pose


@dataclass(frozen=True)
class Closure:
    """Two frames, on two links, that a file holds together: a loop of the links.

    Parameters
    ----------
    name : str
        A phrase such as ``"<connect> of bodies a and b"``.
    links : tuple of two str
    frames : tuple of two (4, 4) arrays
        Each in its link's frame, metres.
    is_rigid : bool
        Whether the frames' directions are held together as well (a weld), or their origins alone (a connect).
    """

    name: str
    links: tuple[str, str]
    frames: tuple[FloatArray, FloatArray]
    is_rigid: bool = False


@dataclass(frozen=True)
class JointEquation:
    """A sum of polynomials of joint positions that a file holds at zero.

    Parameters
    ----------
    name : str
        A phrase such as ``"joint a that follows b by a polynomial"``.
    polynomials : mapping of str to tuple of float
        By joint, its coefficients in ascending order; constants may be spread over the joints.
    """

    name: str
    polynomials: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Robot:
    """The links below a palm link and the joints between them.

    Parameters
    ----------
    name : str
    root : str
        The palm.
    links : tuple of str
        The root first, parents before children.
    joints : tuple of Joint
        In the order of the links they lead to.
    shapes : mapping
        Link to its collision shapes, in the link's frame.
    missing : tuple of str
        Mesh files that were not found, with the link they belong to.
    source : str
        Name of the file it was read from.
    sha256 : str
        Of that file's bytes, hexadecimal.
    shapeless : tuple of str
        Visible links without a collision shape.
    negated_limits : tuple of str
        Mimic joints whose limits were taken with the other sign (``urdf_reader.orient_mimics``).
    unmodelled_couplings : tuple of str
        Couplings of joints in the file that are left out, a phrase each.
    units : UrdfUnits
        Units of the file's numbers; all values here are metres and radians.
    mimicked_loops : tuple of str
        Closed linkages of a URDF that its mimic joints are taken to keep, a phrase each.
    unreadable : tuple of str
        Links whose collision shapes are all among the missing ones.
    empty_ranges : tuple of str
        Mimic joints with a range from 0 to 0, which is taken as none.
    path : Path, optional
        Of that file, where it was read from a file.
    closures : tuple of Closure
        What closes loops of its links.
    equations : tuple of JointEquation
        Couplings of joints that are no mimic relations.
    passive : tuple of str
        Free joints that no actuator of the file moves, and that closures or equations move with the others.
    springs : mapping of str to pair of float
        Stiffness (newton-metres a radian, newtons a metre) and rest position of the springs at joints of a hand with
        closures or equations, if no actuator moves them.
    stops : tuple of (Joint, float)
        Joints without an actuator that springs hold at a limit, with that limit: among ``joints`` they are fixed
        there, unless the robot is ``released``.
    assumed_drives : tuple of str
        Free joints that no actuator of the file moves, nor closures or equations with the others.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    shapes: Mapping[str, tuple[CollisionShape, ...]] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    source: str = ""
    sha256: str = ""
    shapeless: tuple[str, ...] = ()
    negated_limits: tuple[str, ...] = ()
    unmodelled_couplings: tuple[str, ...] = ()
    units: UrdfUnits = SI
    mimicked_loops: tuple[str, ...] = ()
    unreadable: tuple[str, ...] = ()
    empty_ranges: tuple[str, ...] = ()
    path: Path | None = None
    closures: tuple[Closure, ...] = ()
    equations: tuple[JointEquation, ...] = ()
    passive: tuple[str, ...] = ()
    springs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    stops: tuple[tuple[Joint, float], ...] = ()
    assumed_drives: tuple[str, ...] = ()

    @cached_property
    def free_joints(self) -> tuple[Joint, ...]:
        """The moving joints that are not mimic joints."""
        return tuple(j for j in self.joints if j.moves and j.mimic is None)

    @property
    def mesh_files(self) -> dict[str, str]:
        """SHA-256 of each mesh file of the collision shapes, by name in the robot file."""
        files = (shape.file for shapes in self.shapes.values() for shape in shapes)
        return {file.name: file.sha256 for file in files if file is not None}

    @cached_property
    def parents(self) -> dict[str, str]:
        """Parent link of each link."""
        return {j.child: j.parent for j in self.joints}

    @cached_property
    def rigid_groups(self) -> dict[str, str]:
        """Topmost link of each link's rigid group (links joined by fixed joints)."""
        by_child = {j.child: j for j in self.joints}
        groups: dict[str, str] = {}
        for link in self.links:
            joint = by_child.get(link)
            groups[link] = link if joint is None or joint.moves else groups[joint.parent]
        return groups

    def fixed_transform(self, link: str, other: str) -> FloatArray | None:
        """Return the transform (4, 4) from one link's frame to another's if they are rigidly connected, else None."""
        groups = self.rigid_groups
        if groups[link] != groups[other]:
            return None
        return np.asarray(np.linalg.inv(self._in_group(other)) @ self._in_group(link))

    def group_shapes(self, link: str) -> list[tuple[CollisionShape, FloatArray]]:
        """Return the shapes of a link's rigid group, each with its transform (4, 4) to the link's frame."""
        result = list[tuple[CollisionShape, FloatArray]]()
        for other, shapes in self.shapes.items():
            transform = self.fixed_transform(other, link)
            if transform is not None:
                result += [(shape, transform) for shape in shapes]
        return result

    def _in_group(self, link: str) -> FloatArray:
        """Return the pose (4, 4) of a link relative to the topmost link of its rigid group."""
        pose, top = np.eye(4), self.rigid_groups[link]
        for joint in reversed(self.chain(link)):
            if joint.child == top:
                break
            pose = joint.frame @ pose
        return pose

    def adjacent(self, a: str, b: str) -> bool:
        """Return whether one moving joint, or one that closes a loop, is between two links."""
        groups = self.rigid_groups
        ends = [*((j.parent, j.child) for j in self.joints if j.moves), *(closure.links for closure in self.closures)]
        return any({groups[a], groups[b]} == {groups[one], groups[other]} for one, other in ends)

    @property
    def stop_positions(self) -> dict[str, float]:
        """Positions of the joints that springs hold at a limit."""
        return {joint.name: position for joint, position in self.stops}

    def released(self) -> Robot:
        """Return the robot with the joints moving that springs hold at a limit."""
        moving = {joint.name: joint for joint, _ in self.stops}
        return replace(
            self,
            joints=tuple(moving.get(joint.name, joint) for joint in self.joints),
            passive=(*self.passive, *moving),
        )

    @property
    def has_linkages(self) -> bool:
        """Whether the free joints have to keep equations."""
        return bool(self.closures or self.equations)

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float, str]]:
        """Lower limit, upper limit and name of the limiting joint, by free joint.

        Joints that follow a free joint narrow its range by their own limits: the limiting joint is the last that did,
        or the free joint itself.
        """
        result = {j.name: (j.lower, j.upper, j.name) for j in self.free_joints}
        for joint in self.joints:
            if joint.moves and joint.mimic is not None:
                driver, multiplier, offset = self.driving_joint(joint)
                lower, upper, _ = result[driver]
                if multiplier == 0.0:
                    if not joint.lower <= offset <= joint.upper:
                        result[driver] = (np.inf, -np.inf, joint.name)
                    continue
                a, b = sorted(((joint.lower - offset) / multiplier, (joint.upper - offset) / multiplier))
                if a > lower or b < upper:
                    result[driver] = (max(lower, a) + 0.0, min(upper, b) + 0.0, joint.name)  # no -0
        return result

    def driving_joint(self, joint: Joint) -> tuple[str, float, float]:
        """Return the free joint that drives a moving joint, with multiplier and offset.

        Chains of mimic joints are resolved.
        """
        by_name = {j.name: j for j in self.joints}
        name, multiplier, offset = joint.name, 1.0, 0.0
        while (mimic := by_name[name].mimic) is not None:
            multiplier, offset = multiplier * mimic.multiplier, multiplier * mimic.offset + offset
            name = mimic.joint
        return name, multiplier, offset

    def chain(self, link: str) -> tuple[Joint, ...]:
        """Return the joints from the root to a link."""
        by_child = {j.child: j for j in self.joints}
        chain: list[Joint] = []
        while link != self.root:
            chain.insert(0, by_child[link])
            link = by_child[link].parent
        return tuple(chain)


@dataclass(frozen=True)
class Inertial:
    """Mass, centre of mass and inertia of a link.

    Parameters
    ----------
    mass : float
        Kilograms.
    center : (3,) array
        Centre of mass, metres, link frame.
    inertia : (3, 3) array
        About the centre of mass, in axes parallel to the link's, kg m^2.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray


def fix_joint(joint: Joint, position: float) -> Joint:
    """Return a joint fixed at a position, radians or metres."""
    moved = joint.frame @ joint_motion(joint.kind == "prismatic", joint.axis, position)
    return replace(joint, kind="fixed", xyz=moved[:3, 3].copy(), rpy=euler_angles(moved[:3, :3]), lower=0.0, upper=0.0)


def euler_angles(rotation: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (3,) of a rotation (3, 3), accurate near the singularity as well."""
    yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    rest = Rotation.from_euler("z", -yaw).as_matrix() @ rotation  # = Ry(pitch) Rx(roll)
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])


def joint_motion(slides: bool, axis: FloatArray, position: float | FloatArray) -> FloatArray:
    """Return the transform (4, 4) of a joint's motion along or about an axis (3,); (b, 4, 4) for positions (b,)."""
    offsets = np.multiply.outer(position, axis)
    pose = np.zeros((*np.shape(position), 4, 4)) + np.eye(4)
    if slides:
        pose[..., :3, 3] = offsets
    else:
        pose[..., :3, :3] = Rotation.from_rotvec(offsets).as_matrix()
    return pose


def check_mimics(source: Path, joints: tuple[Joint, ...]) -> None:
    """Raise for mimic joints that follow each other, or a joint that is missing or fixed."""
    moving = {j.name: j for j in joints if j.moves}
    for joint in moving.values():
        visited, current = [joint.name], joint
        while current.mimic is not None:
            target = current.mimic.joint
            if target not in moving:
                others = [name for name in moving if name != current.name]
                similar = [name for name in others if target and name.endswith(target)]
                allowed = "a moving joint: " + ", ".join(similar or others)
                raise_invalid(source, f"joint {current.name} that mimics {target!r}", allowed)
            current = moving[target]
            if current.name in visited:
                raise_invalid(source, f"joints that mimic each other: {', '.join(visited)}", "a joint to follow")
            visited.append(current.name)


def check_ranges(source: Path, robot: Robot) -> None:
    """Raise for joints whose mimic joints leave an empty range."""
    for joint in robot.free_joints:
        lower, upper, follower = robot.ranges[joint.name]
        if lower > upper or (lower == upper and joint.lower < joint.upper):
            given = f"joint {joint.name} with joint {follower} that follows it"
            raise_invalid(source, given, "limits that both can keep")


def raise_invalid(source: Path, given: str, allowed: str) -> NoReturn:
    """Raise ``InputError`` for an invalid statement in a robot file."""
    raise InputError(f"URDFHand.path: {source.name}", given, allowed)
