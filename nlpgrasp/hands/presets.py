"""Presets of common hands: fingertips, approach and effort limits for their URDFs.

Each hand has a function of its name, which documents its data, and a ``Preset`` that holds them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NoReturn, TypedDict, Unpack

import numpy as np

from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot import Joint, Robot
from nlpgrasp.hands.robot_file import read_robot, robot_links
from nlpgrasp.hands.suggested_tips import tip_of
from nlpgrasp.hands.tips import CapsuleTip, FlatTip, SphereTip, Tip
from nlpgrasp.hands.urdf_hand import URDFHand

CLEARANCE = 2e-3  # metres between links and body, for the positioning error of an arm
QUARTER = np.pi / 2.0  # radians, a quarter turn
PANDA_FORCE = 70.0  # newtons on each finger
ROBOTIQ_PAD = FlatTip((0.022, 0.0375), (0.0, -0.003175, 0.0), (QUARTER, 0.0, 0.0))

Direction = tuple[float, float, float]


def allegro(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Allegro hand (Wonik Robotics), right or left: four fingers, 16 joints.

    Contacts, in this order: the three fingers (links ``link_3.0_tip``, ``link_7.0_tip``, ``link_11.0_tip``) and the
    thumb (``link_15.0_tip``), each a sphere of 12 mm around the link's origin, as the collision shape of the maker's
    URDF. The palm (``palm_link``) faces along its x axis.

    Torque limits: 0.7 N m a joint, the greatest torque of the maker's technical specification. The URDF's effort of
    15 is a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return ALLEGRO.hand(urdf, **options)


def barrett(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the BarrettHand (BH8-28x): three fingers.

    Contacts: ``finger_1_dist_link``, ``finger_2_dist_link`` and ``finger_3_dist_link``, spheres of 7 mm in the end of
    each link, 51 mm from its joint. The palm (``base_link``) faces along its z axis.

    Torque limits: the maker's 15 N at the fingertip takes 1.7 N m of a finger's inner joint, 114 mm away with the
    finger straight, and 0.77 N m of the outer one (its torque sensor ends at 1 N m). The joints that spread the
    fingers, with the same motors, are taken to hold 1.7 N m. The URDF states an effort of 0. One motor drives both
    joints of a finger; the URDF lets them move on their own.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return BARRETT.hand(urdf, **options)


def leap(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the LEAP hand (v1): four fingers, 16 joints.

    Contacts, in this order: the three fingers (links ``fingertip``, ``fingertip_2``, ``fingertip_3``) and the thumb
    (``thumb_fingertip``). Each is a sphere whose end is 48 mm (thumb: 60 mm) along -y of the link, where public URDFs
    have the tip's frame. Its radius of 12 mm is an assumption: hands are printed, measure yours. The palm
    (``palm_lower``) faces along -z: there the fingers close.

    Torque limits: 0.93 N m a joint, the stall torque of its motors at 5 V (ROBOTIS, Dynamixel XC330-M288-T); the
    current limits that its software sets take a part of that.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return LEAP.hand(urdf, **options)


def panda(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the gripper of a Panda or FR3 arm (Franka Hand): two pads, one joint; the arm is left out.

    Contacts: the pads of the left and right finger (links ``leftfinger``, ``rightfinger``, with any prefix), flat
    rectangles of 17.5 mm by 18.5 mm where the maker's URDF has the rubber tips. The palm (``panda_hand``) faces along
    its z axis.

    Force limits: 70 N on each finger, the maker's continuous grasping force (140 N is the greatest, for a moment). A
    joint that drives both fingers therefore gets 140 N.

    Parameters
    ----------
    urdf : str or Path, optional
        The URDF of gripper or arm; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return PANDA.hand(urdf, **options)


def robotiq_2f85(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 2F-85 gripper: two pads, one joint.

    Contacts: the pads ``left_inner_finger_pad`` and ``right_inner_finger_pad`` of the ROS-Industrial description, flat
    rectangles of 22 mm by 37.5 mm. The palm (``robotiq_arg2f_base_link``) faces along its z axis.

    Torque limit: 25 N m at ``finger_joint``. The maker's greatest grip force is 235 N; a pad's stroke of 42.5 mm over
    0.8 rad is 53 mm a radian, and the joint moves both pads: 2 x 235 N x 0.053 m. The URDF's 1000 is a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return ROBOTIQ_2F85.hand(urdf, **options)


def robotiq_3f(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 3-Finger gripper, with all of its joints free (its linkage couples those of a finger).

    Contacts: ``finger_1_link_3``, ``finger_2_link_3`` and ``finger_middle_link_3``, spheres of 11 mm in the end of the
    last link, 26 mm from its joint. The palm (``palm``) faces along its y axis.

    Torque limits of a finger's joints: 7, 4 and 1.6 N m, which its greatest force of 60 N at the tip (the maker's
    manual, register FORCE) takes of each with the finger straight. The joints that spread the fingers keep the URDF's
    effort, a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF. ``robot_descriptions`` has none.
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return ROBOTIQ_3F.hand(urdf, **options)


def shadow(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Shadow Dexterous Hand, right or left: five fingers, from the palm on (the wrist is left out).

    Contacts, in this order: first, middle, ring and little finger (links ``ffdistal``, ``mfdistal``, ``rfdistal``,
    ``lfdistal``, with any prefix such as ``rh_``), spheres of 7 mm, 24 mm along the link's z axis, and the thumb
    (``thdistal``), 9 mm and 26 mm: the ends of the capsules that stand for these links in gymnasium-robotics' model
    of the hand. Where the file has capsules there, as that model (MJCF), the fingertips are the capsules.
    The palm (``palm``) faces along its -y axis.

    Torque limits: the URDF's efforts, which are the maker's. The two outer joints of each finger share a tendon; its
    URDF lets them move on their own.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF. ``robot_descriptions`` has none.
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return SHADOW.hand(urdf, **options)


class Options(TypedDict, total=False):
    """Keyword arguments of a preset, with the meaning of those of ``URDFHand.load``.

    ``palm`` selects one of two hands in a URDF; ``torque_limits`` and ``clearance`` replace the preset's.
    """

    palm: str
    torque_limits: Mapping[str, float] | float
    clearance: float
    spheres_per_link: int
    self_collision: bool


@dataclass(frozen=True)
class Preset:
    """Fixed data of a hand model: palm, fingertips, approach and limits.

    Parameters
    ----------
    name : str
        Of the function that makes it.
    palms : tuple of str
        Names of the palm's link, with any prefix: the first that all fingertips hang from.
    tips : mapping
        Link (with any prefix) to its fingertip, or to a function of the joint above the link that returns it.
    approach : (3,) tuple
        Direction in which the palm faces, palm frame.
    limits : function
        Of the robot, to torque limits by joint.
    description : str
        Module of ``robot_descriptions`` that holds its URDF, empty where there is none.
    """

    name: str
    palms: tuple[str, ...]
    tips: Mapping[str, Tip | Callable[[Joint], Tip]]
    approach: Direction
    limits: Callable[[Robot], Mapping[str, float]]
    description: str = ""

    def hand(self, urdf: str | Path | None, **options: Unpack[Options]) -> URDFHand:
        """Return the hand of a URDF or MJCF file.

        A spherical tip is the capsule instead where that is the collision shape of the link in the file.

        Parameters
        ----------
        urdf : str or Path, optional
            Found through the package ``robot_descriptions`` when left out.
        **options
            Of ``Options``.

        Raises
        ------
        InputError
            When there is no URDF, or it lacks a link of this hand.
        """
        path = self._described() if urdf is None else urdf
        robot = read_robot(path, options["palm"]) if "palm" in options else self._robot_below_palm(path)
        self._check_tips(path, [robot])
        options["palm"] = robot.root
        above = {joint.child: joint for joint in robot.joints}
        tips: dict[str, float | Tip | Sequence[Tip]] = {}
        for name, tip in self.tips.items():
            link = self._tip(path, robot, name)
            own = tip_of(robot.shapes.get(link, ()))
            stated = tip if isinstance(tip, Tip) else tip(above[link])
            tips[link] = own if isinstance(own, CapsuleTip) and isinstance(stated, SphereTip) else stated
        options.setdefault("torque_limits", self.limits(robot))
        options.setdefault("clearance", CLEARANCE)
        return URDFHand.load(path, tips, approach=self.approach, **options)

    def _robot_below_palm(self, path: str | Path) -> Robot:
        """Return the robot below the palm: a link with one of its names that all fingertips hang from.

        A frame of that name without fingers is no palm. Among nested links with the same name but for prefixes, such as
        the bases of an arm and of its hand, it is the innermost.
        """
        links = robot_links(path)
        candidates: list[Robot] = []
        broken: list[InputError] = []
        for name in self.palms:
            holding: list[Robot] = []
            for link in self._matches(links, name):
                try:
                    robot = read_robot(path, link)
                except InputError as error:  # an arm's joint of an unsupported kind below a link of this name
                    broken.append(error)
                    continue
                candidates.append(robot)
                holding += [] if self._without(robot) else [robot]
            inner = [r for r in holding if not any(o.root in r.links for o in holding if o is not r)]
            exact = [r for r in inner if r.root == name]
            if len(inner) > 1 and not exact:
                given = f"{Path(path).name} with links {', '.join(r.root for r in inner)}"
                raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")
            if inner:
                return (exact or inner)[0]
        if broken:
            raise broken[0]
        if not candidates:
            self._refuse(f"{Path(path).name} without a link {' or '.join(self.palms)}")
        self._check_tips(path, candidates)
        return candidates[0]

    def _check_tips(self, path: str | Path, robots: Sequence[Robot]) -> None:
        """Refuse a file in which no palm carries all fingertips; the message names what is missing."""
        lacking = {robot.root: self._without(robot) for robot in robots}
        if not all(lacking.values()):
            return
        links = robot_links(path)
        absent = [tip for tip in self.tips if not self._matches(links, tip)]
        if absent:
            self._refuse(f"{Path(path).name} without a link {absent[0]}")
        apart = "; ".join(f"{', '.join(tips)} not below {palm}" for palm, tips in lacking.items())
        self._refuse(f"{Path(path).name} with {apart}")

    def _without(self, robot: Robot) -> list[str]:
        """Return the fingertips that do not hang from a robot's root, by their names in the preset."""
        return [tip for tip in self.tips if not self._matches(robot.links, tip)]

    def _matches(self, links: Sequence[str], name: str) -> list[str]:
        """Return the links with a name, whatever their prefix."""
        longer = [other for other in self.tips if other.endswith(f"_{name}")]  # thumb_fingertip is not a fingertip
        return [link for link in links if _has_name(link, name) and not any(_has_name(link, other) for other in longer)]

    def _tip(self, path: str | Path, robot: Robot, name: str) -> str:
        """Return a fingertip's link: the one with exactly this name, or the only one with a prefix."""
        matches = [name] if name in robot.links else self._matches(robot.links, name)
        if len(matches) > 1:
            given = f"{Path(path).name} with links {', '.join(matches)}"
            raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")
        return matches[0]

    def _refuse(self, given: str) -> NoReturn:
        raise InputError(f"hands.{self.name}.urdf", given, "the URDF of this hand; ng.URDFHand.load takes any other")

    def _described(self) -> str:
        field = f"hands.{self.name}.urdf"
        if not self.description:
            raise InputError(field, "nothing", "the path of its URDF (robot_descriptions has none of this hand)")
        try:
            module = import_module(f"robot_descriptions.{self.description}")
        except ModuleNotFoundError:
            install = 'pip install "nlpgrasp[descriptions]"'
            raise InputError(field, "nothing", f"the path of its URDF, or robot_descriptions: {install}") from None
        except Exception as error:  # robot_descriptions clones a repository: any error of git or the network
            given = f"{self.description}, which robot_descriptions cannot fetch ({type(error).__name__}: {error})"
            raise InputError(field, given, "the path of its URDF") from None
        path = getattr(module, "URDF_PATH", None)
        if path is None:
            given = f"{self.description}, of which robot_descriptions has no plain URDF"
            raise InputError(field, given, "the path of its URDF")
        return str(path)


def _has_name(link: str, name: str) -> bool:
    """Return whether a link has a name, with any prefix."""
    return link == name or link.endswith(tuple(f"{mark}{name}" for mark in "_:/"))


def equal_efforts(torque: float) -> Callable[[Robot], Mapping[str, float]]:
    """Return equal limits for all joints, newton-metres, as a function of the robot."""
    return lambda robot: {joint.name: torque for joint in robot.free_joints}


def efforts_by_name(limits: Mapping[str, float]) -> Callable[[Robot], Mapping[str, float]]:
    """Return limits by the endings of joint names; the URDF's efforts for the other joints."""

    def of(robot: Robot) -> Mapping[str, float]:
        efforts = {joint.name: joint.effort for joint in robot.free_joints if joint.effort}
        ends = {j.name: t for j in robot.free_joints for end, t in limits.items() if j.name.endswith(end)}
        return {**efforts, **ends}

    return of


def efforts_of_file(robot: Robot) -> Mapping[str, float]:
    """Return the efforts that the URDF states."""
    return {joint.name: joint.effort for joint in robot.free_joints if joint.effort}


def _panda_pad(joint: Joint) -> FlatTip:
    """Return a finger's pad, which faces where the finger closes to: against its joint's axis (y or -y)."""
    side = 1.0 if joint.axis[1] > 0.0 else -1.0
    return FlatTip((0.0175, 0.0185), (0.0, 0.0, 0.04525), (side * QUARTER, 0.0, 0.0))


def _panda_limits(robot: Robot) -> Mapping[str, float]:
    """Return the continuous force of each finger, times the fingers that a joint drives, newtons."""
    driven = [robot.driving_joint(joint)[0] for joint in robot.joints if joint.kind == "prismatic"]
    return {joint.name: PANDA_FORCE * driven.count(joint.name) for joint in robot.free_joints}


ALLEGRO = Preset(
    "allegro",
    ("palm_link", "palm", "base_link"),
    {f"link_{last}.0_tip": SphereTip(0.012) for last in (3, 7, 11, 15)},
    (1.0, 0.0, 0.0),
    equal_efforts(0.7),
    "allegro_hand_description",
)


BARRETT = Preset(
    "barrett",
    ("base_link",),
    {f"finger_{i}_dist_link": SphereTip(0.007, (-0.038, 0.034, 0.0)) for i in (1, 2, 3)},
    (0.0, 0.0, 1.0),
    efforts_by_name({"prox_joint": 1.7, "med_joint": 1.7, "dist_joint": 0.77}),
    "barrett_hand_description",
)


LEAP = Preset(
    "leap",
    ("palm_lower",),
    {name: SphereTip(0.012, (0.0, -0.036, 0.015)) for name in ("fingertip", "fingertip_2", "fingertip_3")}
    | {"thumb_fingertip": SphereTip(0.012, (0.0, -0.048, -0.015))},
    (0.0, 0.0, -1.0),
    equal_efforts(0.93),
    "leap_hand_v1_description",
)


PANDA = Preset(
    "panda",
    ("panda_hand", "hand"),
    {"leftfinger": _panda_pad, "rightfinger": _panda_pad},
    (0.0, 0.0, 1.0),
    _panda_limits,
    "panda_description",
)


ROBOTIQ_2F85 = Preset(
    "robotiq_2f85",
    ("robotiq_arg2f_base_link", "robotiq_85_base_link"),
    {"left_inner_finger_pad": ROBOTIQ_PAD, "right_inner_finger_pad": ROBOTIQ_PAD},
    (0.0, 0.0, 1.0),
    efforts_by_name({"finger_joint": 25.0}),
    "robotiq_2f85_description",
)


ROBOTIQ_3F = Preset(
    "robotiq_3f",
    ("palm",),
    {f"finger_{name}_link_3": SphereTip(0.011, (0.0205, 0.016, 0.0)) for name in ("1", "2", "middle")},
    (0.0, 1.0, 0.0),
    efforts_by_name({"joint_1": 7.0, "joint_2": 4.0, "joint_3": 1.6}),
)


SHADOW = Preset(
    "shadow",
    ("palm",),
    {f"{finger}distal": SphereTip(0.007, (0.0, 0.0, 0.024)) for finger in ("ff", "mf", "rf", "lf")}
    | {"thdistal": SphereTip(0.009, (0.0, 0.0, 0.026))},
    (0.0, -1.0, 0.0),
    efforts_of_file,
)


PRESETS = {make.__name__: make for make in (allegro, barrett, leap, panda, robotiq_2f85, robotiq_3f, shadow)}


__all__ = ["allegro", "barrett", "leap", "panda", "robotiq_2f85", "robotiq_3f", "shadow"]
