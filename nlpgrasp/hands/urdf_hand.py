"""Robot hand read from a URDF or MJCF file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import ClassVar, NoReturn

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.registry import incomplete_data
from nlpgrasp.common.robot_files import MJCF_ENDINGS
from nlpgrasp.common.scalar_constraints import UNIT_QUATERNION, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import (
    LARGEST_TIP,
    MOST,
    FloatArray,
    array,
    format_known_names,
    hand_length,
    number,
)
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import HandVariable, Values
from nlpgrasp.hands.file_units import check_units, refuse_implausible_lengths, unit_questions
from nlpgrasp.hands.finger_chains import arm_above
from nlpgrasp.hands.fitted_tips import fit_hull_tips
from nlpgrasp.hands.kinematics import LinkTree, require_kinematics
from nlpgrasp.hands.linked_hand import LinkedHand
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.suggested_tips import (
    MOST_OVERHANG,
    borrowed_shapes,
    leaf_links,
    noticeable_overhang,
    overhang,
    suggest_tip,
    thick_link_warnings,
    tip_from_shapes,
)
from nlpgrasp.hands.tips import HullTip, SphereTip, SymbolicTouch, Tip
from nlpgrasp.hands.visible_shapes import visible_warning

ROUNDING = 1e-9  # metres: rounding tolerance of an overhang
MEANT_AS_RADIANS = float(np.radians(2.0 * np.pi))  # radians: a full turn in radians, misread as degrees
POINT_CLEARANCE = 1e-3  # metres: distance from the body of surface points of links without a fingertip


Fingertips = Mapping[str, float | Tip | Sequence[Tip] | None] | Sequence[str]


class URDFHand(LinkedHand):
    """A robot hand whose palm pose and joint positions are variables of the program; made by ``load``.

    Parameters
    ----------
    tree : LinkTree
        Kinematic tree.
    torque_limits : mapping of str to float, optional
        By joint, newton-metres (newtons for sliding joints).
    clearance, self_collision
        As for ``load``.

    Attributes
    ----------
    robot : Robot
        The palm and all links below it.
    tips : tuple of (str, Tip)
        Link and patch of each contact, in the order of the contacts.
    """

    kind: ClassVar[str] = "urdf"

    def __init__(
        self,
        tree: LinkTree,
        torque_limits: Mapping[str, float] | None = None,
        *,
        clearance: float = 0.0,
        self_collision: bool = True,
    ) -> None:
        self.tree, self.robot, self.tips = tree, tree.robot, tree.tips
        self.count = len(self.tips)
        self.clearance = number("URDFHand.clearance", clearance, at_least=0.0)
        if not isinstance(self_collision, bool):
            raise InputError("URDFHand.self_collision", self_collision, "True or False")
        self.self_collision, self.torque_limits = self_collision, dict(torque_limits or {})
        if not self.robot.free_joints:
            fixed = ", ".join(j.name for j in self.robot.joints)
            given = f"no movable joints below {self.robot.root}" + (f" (fixed: {fixed})" if fixed else "")
            raise InputError(f"URDFHand.path: {self.robot.source}", given, "a hand with joints that move")

    @classmethod
    def load(
        cls,
        path: str | Path,
        fingertips: Fingertips | None = None,
        torque_limits: Mapping[str, float] | float | None = None,
        *,
        palm: str | None = None,
        approach: ArrayLike = (0.0, 0.0, 1.0),
        clearance: float = 0.0,
        self_collision: bool = True,
        tip_overhang: float | None = None,
        scale: float = 1.0,
        degrees: bool = False,
    ) -> URDFHand:
        """Return the hand of a robot file.

        Parameters
        ----------
        path : str or Path
            A URDF or MuJoCo's MJCF (extra ``sim``); the root element says
            which. Bodies of an MJCF are links, hinges and slides are joints.
        fingertips : mapping or sequence of str
            Link name to a radius (a sphere around the link's origin, metres), a ``Tip``, or several tips; None, or
            names alone, take the only sphere or capsule among the link's collision shapes, or else the rounded convex
            hull of the link's end (``HullTip``), facing where the finger closes. Contact i belongs to
            fingertip i, in this order. Inner links and the palm may have tips too. Left out, the error names links.
        torque_limits : mapping of joint names to floats, or float, optional
            Newton-metres (newtons for sliding joints), for the force budget ``"hand_torques"``; the URDF's efforts
            when left out.
        palm : str, optional
            Link whose pose is a variable; the root when left out. Links that are not below it are left out.
        approach : (3,) array
            Direction in which the palm faces, palm frame.
        clearance : float
            Least distance from the body of links that are not rigidly connected to a fingertip, metres.
        self_collision : bool
            Keep the links from each other.
        tip_overhang : float, optional
            Largest distance of a fingertip beyond the collision shapes of its link, metres: there the finger itself
            does not touch. 5 mm if not given, with a warning from 1 mm on.
        scale : float
            Factor on the coordinates of a URDF's mesh files, beside the ``scale`` of each ``<mesh>``: 0.001 where they
            are millimetres without saying so.
        degrees : bool
            Whether a URDF's limits (and mimic offsets) of revolute joints are degrees, against the format.

        Raises
        ------
        InputError
            On fingertips off their links, on files, links, joints or limits that cannot be used, and on meshes or
            joint offsets beyond 10 m; unknown link names list those there are.
        MissingExtraError
            Without adam-robotics, which solves need; on MJCF without MuJoCo, and on meshes in COLLADA without their
            reader.

        Warns
        -----
        UserWarning
            On fingertips more than a millimetre beyond the shapes of their links, or within these. On missing mesh
            files and on visible links without a collision shape: the other shapes are used. On mimic joints with a
            negative multiplier whose limits lack the sign: they are taken with it. On tendons of an MJCF that couple
            joints without an equality: they are not modelled. On joints of its linkages that no actuator moves: they
            are taken to be driven, or kept at a limit where springs hold them. On linkages that a URDF closes and its
            mimic joints have to keep. On an MJCF whose joints hardly turn: its limits may be radians without stating
            so. On meshes far longer than the joints are apart, or far shorter, and on limits beyond a full turn: their
            units may be others.
        """
        return cls.from_robot(
            read_robot(path, palm, check_units(scale, degrees)),
            fingertips,
            torque_limits,
            approach=approach,
            clearance=clearance,
            self_collision=self_collision,
            tip_overhang=tip_overhang,
        )

    @classmethod
    def from_robot(
        cls,
        robot: Robot,
        fingertips: Fingertips | None = None,
        torque_limits: Mapping[str, float] | float | None = None,
        *,
        approach: ArrayLike = (0.0, 0.0, 1.0),
        clearance: float = 0.0,
        self_collision: bool = True,
        tip_overhang: float | None = None,
    ) -> URDFHand:
        """Return the hand of a robot that was already read from a file; other arguments as for ``load``."""
        refuse_implausible_lengths(robot)
        for text in file_warnings(robot):
            warn(f"{robot.source}: {text}")
        tips = resolve_tips(robot, fingertips)
        require_kinematics()
        _refuse_arm(robot, tips)
        check_overhangs(robot, tips, tip_overhang)
        if text := visible_warning(robot, dict(tips)):
            warn(f"{robot.source}: {text}")
        for text in thick_link_warnings(robot, tips):
            warn(text)
        return cls(
            LinkTree(robot, tips, unit_approach(approach)),
            resolve_torque_limits(robot, torque_limits),
            clearance=clearance,
            self_collision=self_collision,
        )

    @property
    def tip_radii(self) -> tuple[float, ...]:
        """Radius of each round fingertip, metres; 0 for other fingertips."""
        return tuple(tip.standoff for _, tip in self.tips)

    def with_clearance(self, clearance: float) -> URDFHand:
        """Return the same hand with another clearance between its links and the body."""
        result = copy(self)
        result.clearance = number("URDFHand.clearance", clearance)
        return result

    def with_limits(self, limits: FloatArray) -> URDFHand:
        """Return the same hand with other limits of its free joints, (2, m)."""
        result = copy(self)
        result.tree = self.tree.with_limits(limits)
        return result

    def check(self, space: int) -> None:
        """Raise for planar bodies, on which links cannot be placed."""
        if space != 3:
            raise InputError("GraspProblem.hand", "a URDF hand for a planar body", "a body in space")

    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return the variables: palm position, palm quaternion (w, x, y, z), joints, sliding tip coordinates."""
        lower, upper = self.tree.joint_limits
        margin = 1.2 * self.tree.span
        result = [
            HandVariable("palm_position", bounds[0] - margin, bounds[1] + margin, self.tree.span),
            HandVariable("palm_quaternion", np.full(4, -1.05), np.full(4, 1.05)),
            HandVariable("joints", lower, upper),
        ]
        slides = sum(tip.slides for _, tip in self.tips)
        if slides:
            result.append(HandVariable("slides", np.zeros(slides), np.ones(slides)))
        return result

    def values_at(self, posture: Json, points: FloatArray) -> Values:
        """Return the values of all variables in a posture with fingertips at points (k, 3), metres, body frame."""
        values = self.values_of(posture)
        poses = self.tree.body_poses(values)
        slides = [
            tip.slide_at((point - poses[link][:3, 3]) @ poses[link][:3, :3])
            for (link, tip), point in zip(self.tips, points, strict=True)
            if tip.slides
        ]
        return values | {"slides": np.array(slides)} if slides else values

    def rows(self, placement: SymbolicCandidate, variables: dict[str, Expression]) -> list[ScalarConstraint]:
        """Return the constraints: unit quaternion, contacts on fingertips, linkages."""
        rows = [ScalarConstraint(UNIT_QUATERNION, ca.sumsqr(variables["palm_quaternion"]), 1.0, 1.0)]
        poses = self.tree.poses(variables)
        for i, (link, tip, slide) in enumerate(self.tree.tips_with_slides(variables)):
            p, n = placement.positions[i], placement.normals[i]
            rows += tip.rows(SymbolicTouch(link, i, poses[link], p, n, slide, placement.size))
        if self.robot.has_linkages:
            rows += self.tree.linkages.rows(variables["joints"])
        return rows

    def least_clearance(self, link: str) -> float:
        """Return the least distance of a link's surface from the body, metres: none for links with a fingertip.

        A little more than the stated clearance, as points of the surface stand for it.
        """
        return 0.0 if self.has_fingertip(link) else max(POINT_CLEARANCE, self.clearance + 2e-4)

    def has_fingertip(self, link: str) -> bool:
        """Return whether a fingertip is on a link or on one that is fixed to it."""
        groups = self.robot.rigid_groups
        return groups[link] in {groups[tip] for tip, _ in self.tips}

    def to_dict(self) -> Json:
        """Return source, fingerprints, fingertips and limits as JSON data."""
        return {
            "type": self.kind,
            "source": self.robot.source,
            "sha256": self.robot.sha256,
            "meshes": self.robot.mesh_files,
            **self.robot.units.to_dict(),
            "palm": self.robot.root,
            "fingertips": [{"link": link, **tip.to_dict()} for link, tip in self.tips],
            "clearance": self.clearance,
            "missing": list(self.robot.missing),
            "torque_limits": dict(self.torque_limits),
            "approach": self.tree.approach.tolist(),
            "self_collision": self.self_collision,
            **({"stops": self.robot.stop_positions} if self.robot.stops else {}),
            **({"passive": list(self.robot.passive)} if self.robot.passive else {}),
        }

    @classmethod
    def from_dict(cls, data: Json) -> NoReturn:
        """Raise: the data name a URDF but do not contain it."""
        raise incomplete_data(
            "hand of type urdf", "its links, which stay in their file: ng.URDFHand.load(path, fingertips)"
        )


def resolve_tips(robot: Robot, fingertips: Fingertips | None) -> list[tuple[str, Tip]]:
    """Return link and patch of each fingertip, in the given order."""
    if fingertips is None:
        raise InputError("URDFHand.fingertips", "nothing", f"links with their radii, such as {_suggest_tips(robot)}")
    if isinstance(fingertips, list | tuple) and all(isinstance(name, str) for name in fingertips):
        fingertips = dict.fromkeys(fingertips)
    if not isinstance(fingertips, Mapping) or not fingertips:
        raise InputError("URDFHand.fingertips", fingertips, "link names, each with a radius or a tip")
    unknown = [name for name in fingertips if name not in robot.links]
    if unknown:
        raise InputError(
            "URDFHand.fingertips", ", ".join(map(str, unknown)), f"links: {format_known_names(unknown, robot.links)}"
        )
    result: list[tuple[str, Tip]] = []
    from_shapes = _tips_from_shapes(robot, fingertips)
    for link, patch in fingertips.items():
        patches = from_shapes[link] if patch is None else patch
        patch_list = list(patches) if isinstance(patches, list | tuple) else [patches]
        if not patch_list:
            raise InputError(f"URDFHand.fingertips[{link!r}]", patches, "a radius, a tip, or several tips")
        for item in patch_list:
            tip = item if isinstance(item, Tip) else SphereTip(_check_radius(f"URDFHand.fingertips[{link!r}]", item))
            if (link, tip) in result:
                raise InputError(f"URDFHand.fingertips[{link!r}]", patches, "tips that are not the same")
            result.append((link, tip))
    if not result:
        raise InputError("URDFHand.fingertips", fingertips, "at least one tip")
    return result


def _refuse_arm(robot: Robot, tips: Sequence[tuple[str, Tip]]) -> None:
    """Raise for an arm between the palm and the fingers: its joints move what the palm's pose moves already."""
    arm = arm_above(robot, [link for link, _ in tips])
    if arm is not None:
        palm, joints = arm
        given = f"{robot.root}, with an arm of {len(joints)} joints ({', '.join(joints)}) above the fingers"
        raise InputError("URDFHand.palm", given, f"the link that the fingers hang from, probably palm={palm!r}")


def check_overhangs(robot: Robot, tips: Sequence[tuple[str, Tip]], most: float | None) -> None:
    """Raise for fingertips that protrude from their links' shapes by more than ``most``, metres.

    Only a warning is given if ``most`` is not stated.
    """
    limit = MOST_OVERHANG if most is None else number("URDFHand.tip_overhang", most, at_least=0.0)
    for link, tip in tips:
        distance = overhang(tip, link, robot) or 0.0
        field = f"URDFHand.fingertips[{link!r}]"
        text = f"a fingertip that reaches {1e3 * distance:.1f} mm beyond the shapes of its link"
        cure = f"{'' if isinstance(tip, HullTip) else 'None, to fit it to them, or '}another radius or tip"
        if distance > limit + ROUNDING:
            raise InputError(field, text, f"{cure}; tip_overhang={np.ceil(1e3 * distance) / 1e3:g} allows it")
        if most is None and distance > noticeable_overhang(tip):
            warn(f"{field}: {text}: the finger itself does not touch there; expected {cure}")


def _check_radius(field: str, radius: object) -> float:
    """Return the validated radius of a fingertip, metres."""
    return hand_length(field, number(field, radius, above=0.0), LARGEST_TIP)


def _suggest_tips(robot: Robot) -> str:
    """Return the fingertips suggested by the leaf links, as Python code."""
    names = leaf_links(robot)
    examples = ", ".join(f'"{link}": {suggest_tip(robot, link).code}' for link in names[:MOST])
    ending = f" ({len(names) - MOST} more links are at ends)" if len(names) > MOST else ""
    return f"{{{examples}}}{ending}"


def _tips_from_shapes(robot: Robot, fingertips: Mapping[str, object]) -> dict[str, Tip]:
    """Return fingertips for the links stated as None: the link's only sphere or capsule, else a convex hull."""
    unstated = [link for link, patch in fingertips.items() if patch is None]
    shape_tips = {link: tip_from_shapes(robot.shapes.get(link, ())) for link in unstated}
    result = {link: tip for link, tip in shape_tips.items() if tip is not None}
    fitted = [link for link in unstated if link not in result]
    for link in fitted:
        if others := borrowed_shapes(robot, link):
            text = f"a link without a collision shape, fitted to those of {', '.join(others)}, fixed to it"
            warn(f"URDFHand.fingertips[{link!r}]: {text}")
    return {**result, **fit_hull_tips(robot, fitted, [link for link in fingertips if link not in fitted])}


def unit_approach(approach: ArrayLike) -> FloatArray:
    """Return the palm's facing direction as a unit vector (3,)."""
    direction = array("URDFHand.approach", approach, (3,))
    if np.linalg.norm(direction) == 0.0:
        raise InputError("URDFHand.approach", approach, "a direction in the palm's frame")
    return direction / np.linalg.norm(direction)


def resolve_torque_limits(robot: Robot, limits: Mapping[str, float] | float | None) -> dict[str, float]:
    """Return the torque limits by joint, as given or else the file's effort limits."""
    names = [j.name for j in robot.free_joints]
    if limits is None:
        return {j.name: j.effort for j in robot.free_joints if j.effort}
    if isinstance(limits, Mapping):
        unknown = [name for name in limits if name not in names]
        if unknown:
            allowed = f"joints: {format_known_names(unknown, names)}"
            raise InputError("URDFHand.torque_limits", ", ".join(map(str, unknown)), allowed)
        return {k: number(f"URDFHand.torque_limits[{k!r}]", v, above=0.0) for k, v in limits.items()}
    return dict.fromkeys(names, number("URDFHand.torque_limits", limits, above=0.0))


def file_warnings(robot: Robot) -> list[str]:
    """Return the warnings about an accepted robot file, one sentence each."""
    result = []
    if robot.missing:
        result.append(missing_mesh_warning(robot))
    if robot.shapeless:
        result.append(f"nothing keeps links without a collision shape off the body: {', '.join(robot.shapeless)}")
    return result + unit_questions(robot) + modelling_warnings(robot)


def missing_mesh_warning(robot: Robot) -> str:
    """Return the warning about missing mesh files and about links without any other shape."""
    text, links = f"left out {'; '.join(robot.missing)}", robot.unreadable
    if not links:
        return text
    subject = f"links {', '.join(links)} have" if len(links) > 1 else f"link {links[0]} has"
    return f"{text}; {subject} no other shape: collisions with {'them' if len(links) > 1 else 'it'} are not checked"


def modelling_warnings(robot: Robot) -> list[str]:
    """Return the warnings about joints that are modelled differently from the file, one sentence each."""
    result = []
    if robot.negated_limits:
        result.append(f"taken with the other sign: {'; '.join(robot.negated_limits)}")
    if robot.empty_ranges:
        text = "limits 0 to 0 of joints that follow others are taken as none, so that the followed joints' limits count"
        result.append(f"{text}: {', '.join(robot.empty_ranges)}")
    if still := [j.name for j in robot.free_joints if robot.ranges[j.name][0] == robot.ranges[j.name][1]]:
        result.append(f"joints whose limits leave one position do not move: {', '.join(still)}")
    if robot.unmodelled_couplings:
        result.append(f"joints move on their own where the file couples them: {'; '.join(robot.unmodelled_couplings)}")
    if robot.stops:
        result.append(f"joints are kept at the limits where springs hold them: {', '.join(robot.stop_positions)}")
    if robot.assumed_drives:
        result.append(f"joints that no actuator moves are taken to be driven: {', '.join(robot.assumed_drives)}")
    if robot.mimicked_loops:
        result.append(f"closed linkages that mimic joints are taken to keep: {'; '.join(robot.mimicked_loops)}")
    turning = [joint for joint in robot.free_joints if joint.kind == "revolute"]
    widest = max((max(abs(j.lower), abs(j.upper)) for j in turning), default=0.0)
    if robot.source.endswith(MJCF_ENDINGS) and 0.0 < widest < MEANT_AS_RADIANS:
        element = '<compiler angle="radian"/>, without which MuJoCo reads degrees'
        result.append(f"no joint turns by more than {np.degrees(widest):.3g} degrees: the file may lack {element}")
    return result
