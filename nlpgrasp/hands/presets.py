"""Presets of common hands: fingertips, approach and effort limits for their robot files.

``PRESETS`` is the table of their data, and ``load_preset`` reads a robot file with a row of it. Each hand has a
function of its name, which documents its data. ``JAWS`` are parallel grippers as boxes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import NoReturn, TypedDict, Unpack

import numpy as np

from nlpgrasp.common.robot_files import SI, UrdfUnits
from nlpgrasp.errors import InputError
from nlpgrasp.hands.file_units import check_units
from nlpgrasp.hands.parallel_jaw import ParallelJaw
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.robot_file import read_robot, robot_links
from nlpgrasp.hands.suggested_tips import fits_shapes, tip_from_shapes
from nlpgrasp.hands.tips import CapsuleTip, FlatTip, SphereTip, Tip
from nlpgrasp.hands.urdf_hand import URDFHand

QUARTER = np.pi / 2.0  # radians, a quarter turn

Direction = tuple[float, float, float]


@dataclass(frozen=True)
class Preset:
    """Fixed data of a hand model: palm, fingertips, approach and limits.

    Parameters
    ----------
    palms : tuple of str
        Names of the palm's link, with any prefix: the first that all fingertips hang from.
    tips : mapping
        Link (with any prefix) to its fingertip; to two, for a joint above the link that has an axis along +y, and for
        any other; or to None: fitted to the link's shapes.
    approach : (3,) tuple
        Direction in which the palm faces, palm frame.
    limits : mapping of str to float
        Ending of a joint's name to its torque limit, newton-metres; to newtons on each finger for sliding joints. The
        other joints have the file's efforts.
    description : str
        Module of ``robot_descriptions`` that holds its URDF, empty where there is none.
    marks : tuple of str
        Further links (with any prefix) without which a file is not of this hand, where those of the fingertips have
        names that other hands have too.
    joint_marks : tuple of str
        Joints, likewise.
    """

    palms: tuple[str, ...]
    tips: Mapping[str, Tip | tuple[Tip, Tip] | None]
    approach: Direction
    limits: Mapping[str, float] = field(default_factory=dict)
    description: str = ""
    marks: tuple[str, ...] = ()
    joint_marks: tuple[str, ...] = ()


PRESETS = {
    "ability": Preset(
        palms=("thumb_base", "base"),
        tips=dict.fromkeys([f"{finger}_L2" for finger in ("index", "middle", "thumb")]),
        approach=(0.0, 1.0, 0.0),
        marks=("ring_L2", "pinky_L2"),
    ),
    "allegro": Preset(
        palms=("palm_link", "palm", "base_link"),
        tips={f"link_{number}.0_tip": SphereTip(0.012) for number in (3, 7, 11, 15)},
        approach=(1.0, 0.0, 0.0),
        limits={"": 0.7},
        description="allegro_hand_description",
    ),
    "barrett": Preset(
        palms=("base_link",),
        tips=dict.fromkeys([f"finger_{number}_dist_link" for number in (1, 2, 3)]),
        approach=(0.0, 0.0, 1.0),
        limits={"prox_joint": 1.7, "med_joint": 1.7, "dist_joint": 0.77},
        description="barrett_hand_description",
    ),
    "inspire": Preset(
        palms=("palm", "base"),
        tips=dict.fromkeys([f"{finger}_distal" for finger in ("index", "middle", "thumb")]),
        approach=(-1.0, 0.0, 0.0),
        limits={
            "proximal": 0.50,
            "distal": 0.29,
            "thumb_proximal_1": 1.27,
            "thumb_proximal_2": 1.33,
            "thumb_middle": 0.61,
            "thumb_distal": 0.32,
        },
        marks=("thumb_proximal_2", "ring_distal", "pinky_distal"),
    ),
    "leap": Preset(
        palms=("palm_lower",),
        tips=dict.fromkeys(["fingertip", "fingertip_2", "fingertip_3", "thumb_fingertip"]),
        approach=(0.0, 0.0, -1.0),
        limits={"": 0.93},
        description="leap_hand_v1_description",
    ),
    "panda": Preset(
        palms=("panda_hand", "hand"),
        tips=dict.fromkeys(  # a pad faces against its joint's axis
            ("leftfinger", "rightfinger"),
            (
                FlatTip((0.0175, 0.0185), (0.0, 0.0, 0.04525), (QUARTER, 0.0, 0.0)),
                FlatTip((0.0175, 0.0185), (0.0, 0.0, 0.04525), (-QUARTER, 0.0, 0.0)),
            ),
        ),
        approach=(0.0, 0.0, 1.0),
        limits={"": 70.0},
        description="panda_description",
    ),
    "robotiq_2f85": Preset(
        palms=("robotiq_arg2f_base_link", "robotiq_85_base_link"),
        tips=dict.fromkeys(
            ("left_inner_finger_pad", "right_inner_finger_pad"),
            FlatTip((0.022, 0.0375), (0.0, -0.003175, 0.0), (QUARTER, 0.0, 0.0)),
        ),
        approach=(0.0, 0.0, 1.0),
        limits={"finger_joint": 25.0},
        description="robotiq_2f85_description",
    ),
    "robotiq_3f": Preset(
        palms=("palm",),
        tips=dict.fromkeys([f"finger_{name}_link_3" for name in ("1", "2", "middle")]),
        approach=(0.0, 1.0, 0.0),
        limits={"joint_1": 7.0, "joint_2": 4.0, "joint_3": 1.6},
    ),
    "shadow": Preset(
        palms=("palm",),
        tips={
            **{f"{finger}distal": SphereTip(0.007, (0.0, 0.0, 0.024)) for finger in ("ff", "mf", "rf", "lf")},
            "thdistal": SphereTip(0.009, (0.0, 0.0, 0.026)),
        },
        approach=(0.0, -1.0, 0.0),
    ),
}


# the same hands with the names of MuJoCo Menagerie; its Shadow hand has those of the maker
MENAGERIE = {
    "allegro": replace(
        PRESETS["allegro"],
        palms=("palm",),
        tips=dict.fromkeys([f"{finger}_tip" for finger in ("ff", "mf", "rf", "th")]),
        marks=("ff_medial", "th_medial"),
    ),
    "leap": replace(
        PRESETS["leap"],
        palms=("palm",),
        tips=dict.fromkeys([f"{finger}_ds" for finger in ("if", "mf", "rf", "th")]),
        marks=("if_md", "th_px"),
    ),
    "panda": replace(
        PRESETS["panda"],
        palms=("hand",),
        tips=dict(zip(("left_finger", "right_finger"), PRESETS["panda"].tips.values(), strict=True)),
        joint_marks=("finger_joint1", "finger_joint2"),
    ),
    "robotiq_2f85": replace(
        PRESETS["robotiq_2f85"],
        palms=("base_mount", "base"),
        tips=dict.fromkeys(("left_pad", "right_pad")),  # fitted: its pads tilt by up to 1.5 degrees against each other
        limits={"driver_joint": 25.0},
        marks=("left_spring_link", "right_spring_link", "left_driver", "right_driver"),
    ),
}


# parallel grippers in the frame of their own model; the source of each number is in docs/hands.md
JAWS = {
    "panda": ParallelJaw(
        stroke=0.08,
        pad=(0.0185, 0.0175),
        finger=(0.0374, 0.026, 0.022),
        palm_size=(0.208, 0.0633, 0.0919),
        closing_axis="y",
        tcp=(0.0, 0.0, 0.1034),
        max_force=70.0,
    ),
    "robotiq_2f85": ParallelJaw(
        stroke=0.085,
        pad=(0.0375, 0.022),
        finger=(0.052, 0.0337, 0.0354),
        palm_size=(0.085, 0.075, 0.0927),
        closing_axis="y",
        tcp=(0.0, 0.0, 0.142),
        max_force=235.0,
    ),
    "robotiq_2f140": ParallelJaw(
        stroke=0.14,
        pad=(0.065, 0.027),
        finger=(0.1043, 0.0371, 0.039),
        palm_size=(0.085, 0.075, 0.0927),
        closing_axis="y",
        tcp=(0.0, 0.0, 0.1943),
        max_force=125.0,
    ),
    "robotiq_hande": ParallelJaw(
        stroke=0.05,
        pad=(0.021, 0.0211),
        finger=(0.0292, 0.011, 0.0212),
        palm_size=(0.077, 0.077, 0.1069),
        closing_axis="x",
        tcp=(0.0, 0.0, 0.1361),
        max_force=130.0,
    ),
    "schunk_wsg50": ParallelJaw(
        stroke=0.11,
        pad=(0.02, 0.02),  # its length is no maker's: the fingers' width
        finger=(0.0654, 0.016, 0.02),
        palm_size=(0.146, 0.0495, 0.0725),
        closing_axis="x",
        approach_axis="y",
        tcp=(0.0, 0.1016, 0.0),
        max_force=80.0,
    ),
}
# other names of presets, in small letters and digits alone
JAW_ALIASES = dict.fromkeys(("franka", "frankahand", "frankapanda", "pandahand", "fr3", "fr3hand"), "panda")


class Options(TypedDict, total=False):
    """Keyword arguments of a preset, as in ``URDFHand.load``.

    ``palm`` selects one of two hands in a URDF; ``torque_limits`` and ``clearance`` replace the preset's.
    """

    palm: str
    torque_limits: Mapping[str, float] | float
    clearance: float
    self_collision: bool
    tip_overhang: float
    scale: float
    degrees: bool


def ability(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Ability Hand (PSYONIC), right or left: five fingers, three with fingertips (thumb and two).

    Contacts, in this order: the ends of index, middle finger and thumb (links ``index_L2``, ``middle_L2``,
    ``thumb_L2``, with any prefix), fitted to the collision shapes of the file (``HullTip``). The palm (``thumb_base``,
    or ``base`` where the file has no such link) faces along its y axis. A finger has one motor: its outer joint follows
    the inner one.

    Torque limits: the URDF's efforts, which are the maker's: 6 N m, and 1.2 N m of the joint that opposes the thumb.

    Checked against the hands of Alex (example-robot-data) with corrected names of mimic joints. As shipped, that file
    is refused: ``Left_index_q2`` mimics ``index_q1``, where the joint is ``Left_index_q1``.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF. ``robot_descriptions`` has none.
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("ability", urdf, **options)


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
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("allegro", urdf, **options)


def barrett(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the BarrettHand (BH8-28x): three fingers.

    Contacts: the ends of ``finger_1_dist_link``, ``finger_2_dist_link`` and ``finger_3_dist_link``, fitted to the
    collision shapes of the file (``HullTip``). The palm (``base_link``) faces along its z axis.

    Torque limits: the maker's 15 N at the fingertip takes 1.7 N m of a finger's inner joint, 114 mm away with the
    finger straight, and 0.77 N m of the outer one (its torque sensor ends at 1 N m). The joints that spread the
    fingers, with the same motors, are taken to hold 1.7 N m. The URDF states an effort of 0. One motor drives both
    joints of a finger; the URDF lets them move on their own.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("barrett", urdf, **options)


def inspire(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the RH56 hand (Inspire Robots), right or left: five fingers, three with fingertips (thumb and two).

    Contacts, in this order: the ends of index, middle finger and thumb (links ``index_distal``, ``middle_distal``,
    ``thumb_distal``, with any prefix), fitted to the collision shapes of the file (``HullTip``). The names are those
    of robosuite's model. The palm (``palm`` or ``base``) faces along its -x axis.

    Torque limits: 6.5 N at the end of a finger and 12.9 N at that of the thumb, times the largest distances of the ends
    from the joints' axes. These forces were measured with an RH56DFX at its highest setting (the weaker of index and
    middle finger; X. Tan, W. Xie and N. Correll, correlllab/rh56_controller); the maker states 15 N for the thumb. One
    motor drives the two joints of a finger, another the three that bend the thumb; robosuite's model lets them move on
    their own, with placeholders of 20 N m.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF or MJCF. ``robot_descriptions`` has none with these links.
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("inspire", urdf, **options)


def leap(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the LEAP hand (v1): four fingers, 16 joints.

    Contacts, in this order: the ends of the three fingers (links ``fingertip``, ``fingertip_2``, ``fingertip_3``) and
    of the thumb (``thumb_fingertip``), fitted to the collision shapes of the file (``HullTip``): a hand with other
    printed fingertips needs a file with their meshes. The palm (``palm_lower``) faces along -z: there the fingers
    close.

    Torque limits: 0.93 N m a joint, the stall torque of its motors at 5 V (ROBOTIS, Dynamixel XC330-M288-T); the
    current limits that its software sets take a part of that.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("leap", urdf, **options)


def panda(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the gripper of a Panda or FR3 arm (Franka Hand): two pads, one joint; the arm is omitted.

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
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("panda", urdf, **options)


def robotiq_2f85(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 2F-85 gripper: two pads, one joint.

    Contacts: the pads ``left_inner_finger_pad`` and ``right_inner_finger_pad`` of the ROS-Industrial description, flat
    rectangles of 22 mm by 37.5 mm. The palm (``robotiq_arg2f_base_link``) faces along its z axis. Of MuJoCo Menagerie's
    MJCF ``left_pad`` and ``right_pad``, fitted to their shapes: its linkage tilts them against each other.

    Torque limit: 25 N m at ``finger_joint``. The maker's greatest grip force is 235 N; a pad's stroke of 42.5 mm over
    0.8 rad is 53 mm a radian, and the joint moves both pads: 2 x 235 N x 0.053 m. The URDF's 1000 is a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("robotiq_2f85", urdf, **options)


def robotiq_3f(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 3-Finger gripper, with all joints free (the real linkage couples those of a finger).

    Contacts: the ends of ``finger_1_link_3``, ``finger_2_link_3`` and ``finger_middle_link_3``, fitted to the collision
    shapes of the file (``HullTip``). The palm (``palm``) faces along its y axis.

    Torque limits of a finger's joints: 7, 4 and 1.6 N m, which its greatest force of 60 N at the tip (the maker's
    manual, register FORCE) takes of each with the finger straight. The joints that spread the fingers keep the URDF's
    effort, a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF. ``robot_descriptions`` has none.
    **options
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("robotiq_3f", urdf, **options)


def shadow(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Shadow Dexterous Hand, right or left: five fingers, without the wrist.

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
        Those of ``URDFHand.load``, without fingertips and approach.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return load_preset("shadow", urdf, **options)


def jaws(name: str) -> ParallelJaw:
    """Return a parallel gripper of a known model, with sizes and force, in the frame of that model.

    ``"panda"`` is in the frame of ``panda_hand`` (``fr3_hand``), ``"robotiq_2f85"`` and ``"robotiq_2f140"`` in that of
    ``robotiq_arg2f_base_link``, ``"robotiq_hande"`` in that of ``robotiq_hande_link``, ``"schunk_wsg50"`` in that of
    Drake's ``body_frame``. The pads of the 2F grippers move along an arc; the tool centre point is their middle half
    open, at most 12 mm (2F-140: 18 mm) away along the approach from that of any other opening. Sizes and their sources
    are in docs/hands.md; ``dataclasses.replace`` changes single ones.

    Parameters
    ----------
    name : str
        Of a parallel gripper, with or without its maker; case, dashes, spaces and underscores do not matter:
        ``"Robotiq 2F-85"``, ``"2f85"``, ``"Hand-E"``, ``"Franka Hand"``.

    Raises
    ------
    InputError
        On any other name, listing the presets.
    """
    names = {_bare(spelling): preset for preset in JAWS for spelling in (preset, preset.partition("_")[2] or preset)}
    preset = (names | JAW_ALIASES).get(_bare(str(name)))
    if preset is None:
        raise InputError("hands.jaws.name", name, "a parallel gripper: " + ", ".join(JAWS))
    return JAWS[preset]


def _bare(name: str) -> str:
    """Return the letters and digits of a name, in lower case."""
    return "".join(character for character in name.lower() if character.isalnum())


def load_preset(name: str, urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the hand of a preset, read from a URDF or MJCF file.

    The fingertips fit the file: where its link has one capsule, that is the fingertip in place of a sphere; a fingertip
    that does not lie on the link's shapes is fitted to them instead.

    Parameters
    ----------
    name : str
        Of a preset in ``PRESETS``.
    urdf : str or Path, optional
        Found through the package ``robot_descriptions`` when left out.
    **options
        Of ``Options``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks a link of this hand.
    """
    units = check_units(options.get("scale", SI.scale), options.get("degrees", SI.degrees))
    path = described_urdf(name) if urdf is None else urdf
    readers = [_PresetReader(name, preset, path, units) for preset in _variants(name)]
    links = robot_links(path)
    return next((reader for reader in readers if reader.has_links(links)), readers[0]).load(options)


def _variants(name: str) -> tuple[Preset, ...]:
    """Return the data of a preset, for each set of names that files of the hand have."""
    return (PRESETS[name], MENAGERIE[name]) if name in MENAGERIE else (PRESETS[name],)


@dataclass(frozen=True)
class PresetMatch:
    """Hand of a preset in a robot file.

    Parameters
    ----------
    name : str
        Of the preset.
    robot : Robot
        Below the preset's palm.
    palm : str, optional
        The palm that has to be stated, in a file with several hands of this model.
    """

    name: str
    robot: Robot
    palm: str | None = None


def matching_preset(path: str | Path, palm: str | None = None, units: UrdfUnits = SI) -> PresetMatch | None:
    """Return the preset whose palm and fingertips a robot file contains; None if there is none.

    Parameters
    ----------
    path : str or Path
        Of the URDF or MJCF file.
    palm : str, optional
        Link that the preset's palm is, or is below.
    units : UrdfUnits
        Of a URDF's numbers.
    """
    links = robot_links(path)
    for name in PRESETS:
        for preset in _variants(name):
            reader = _PresetReader(name, preset, path, units)
            # a robot is read with its meshes: only where it may be this hand
            match = reader.match(palm) if reader.has_links(links) else None
            if match is not None:
                return match
    return None


@dataclass(frozen=True)
class _PresetReader:
    """Reader of a robot file with a preset's data.

    Parameters
    ----------
    name : str
        Of the preset, for messages.
    preset : Preset
    path : str or Path
        Of the URDF or MJCF file.
    units : UrdfUnits
        Of a URDF's numbers.
    """

    name: str
    preset: Preset
    path: str | Path
    units: UrdfUnits = SI

    def load(self, options: Options) -> URDFHand:
        """Return the hand, with the preset's data for options that are not given."""
        robot = self._read(options["palm"]) if "palm" in options else self.robot_below_palm()
        self._check_tips([robot])
        return URDFHand.from_robot(
            robot,
            self._tips(robot),
            options.get("torque_limits", effort_limits(robot, self.preset.limits)),
            approach=self.preset.approach,
            clearance=options.get("clearance", 0.0),
            self_collision=options.get("self_collision", True),
            tip_overhang=options.get("tip_overhang"),
        )

    def _read(self, palm: str) -> Robot:
        """Return the robot below a link."""
        return read_robot(self.path, palm, self.units)

    def _tips(self, robot: Robot) -> dict[str, float | Tip | Sequence[Tip] | None]:
        """Return the fingertips by link: the preset's, or fitted to the link's shapes where that is not on them."""
        joints = {joint.child: joint for joint in robot.joints}
        result: dict[str, float | Tip | Sequence[Tip] | None] = {}
        for name, tip in self.preset.tips.items():
            link = self._tip_link(robot, name)
            if isinstance(tip, tuple):
                tip = tip[0 if joints[link].axis[1] > 0.0 else 1]
            capsule = tip_from_shapes(robot.shapes.get(link, ()))
            if isinstance(capsule, CapsuleTip) and isinstance(tip, SphereTip):
                tip = capsule
            result[link] = tip if tip is None or fits_shapes(tip, link, robot) else None
        return result

    def match(self, palm: str | None) -> PresetMatch | None:
        """Return the preset's hand, at or below a stated palm; None if the file does not contain it there."""
        try:
            robot = self.robot_below_palm()
            if palm is None or robot.root in self._read(palm).links:
                return PresetMatch(self.name, robot)
        except InputError:  # no palm carries the fingertips, or several do
            pass
        return None if palm is None else self._match_at(palm)

    def _match_at(self, palm: str) -> PresetMatch | None:
        """Return the preset's hand whose palm is a given link; None if there is none."""
        if not any(_has_name(palm, name) for name in self.preset.palms):
            return None
        try:
            robot = self._read(palm)
        except InputError:  # the reader without a preset gives the reason
            return None
        return None if self._missing_links(robot) else PresetMatch(self.name, robot, palm)

    def robot_below_palm(self) -> Robot:
        """Return the robot below the palm: a link with one of the preset's palm names that carries all fingertips.

        A frame of that name without fingers is no palm. Among nested links with the same name but for prefixes, such as
        the bases of an arm and of its hand, it is the innermost.
        """
        links = robot_links(self.path)
        candidates: list[Robot] = []
        errors: list[InputError] = []
        for name in self.preset.palms:
            complete: list[Robot] = []
            for link in self._matching_links(links, name):
                try:
                    robot = self._read(link)
                except InputError as error:  # an arm's joint of an unsupported kind below a link of this name
                    errors.append(error)
                    continue
                candidates.append(robot)
                complete += [] if self._missing_links(robot) else [robot]
            innermost = [r for r in complete if not any(inner.root in r.links for inner in complete if inner is not r)]
            exact = [r for r in innermost if r.root == name]
            if len(innermost) > 1 and not exact:
                self._refuse_ambiguous([r.root for r in innermost])
            if innermost:
                return (exact or innermost)[0]
        if errors:
            raise errors[0]
        if not candidates:
            self._refuse(f"without a link {' or '.join(self.preset.palms)}")
        self._check_tips(candidates)  # none has all fingertips: raises, naming those that are missing
        return candidates[0]

    def has_links(self, links: Sequence[str]) -> bool:
        """Return whether palm and all fingertips are among given links."""
        palm = any(self._matching_links(links, name) for name in self.preset.palms)
        return palm and all(self._matching_links(links, name) for name in self._names)

    def _check_tips(self, robots: Sequence[Robot]) -> None:
        """Raise if no palm in the file carries all fingertips, naming those that are missing."""
        missing = {robot.root: self._missing_links(robot) for robot in robots}
        if not all(missing.values()):
            return
        links = robot_links(self.path)
        absent = [name for name in self._names if not self._matching_links(links, name)]
        if absent:
            self._refuse(f"without a link {absent[0]}")
        self._refuse("with " + "; ".join(f"{', '.join(tips)} not below {palm}" for palm, tips in missing.items()))

    @property
    def _names(self) -> tuple[str, ...]:
        """Names of the fingertip links and of the further links of this hand."""
        return (*self.preset.tips, *self.preset.marks)

    def _missing_links(self, robot: Robot) -> list[str]:
        """Return the names of the preset's links and joints that a robot lacks."""
        joints = [joint.name for joint in robot.joints]
        absent = [name for name in self.preset.joint_marks if not any(_has_name(joint, name) for joint in joints)]
        return [name for name in self._names if not self._matching_links(robot.links, name)] + absent

    def _matching_links(self, links: Sequence[str], name: str) -> list[str]:
        """Return the links with a given name, with any prefix."""
        longer = [tip for tip in self.preset.tips if tip.endswith(f"_{name}")]  # thumb_fingertip is not a fingertip
        return [link for link in links if _has_name(link, name) and not any(_has_name(link, tip) for tip in longer)]

    def _tip_link(self, robot: Robot, name: str) -> str:
        """Return a fingertip's link: the one with exactly this name, or the only one with a prefix before it."""
        matches = [name] if name in robot.links else self._matching_links(robot.links, name)
        if len(matches) > 1:
            self._refuse_ambiguous(matches)
        return matches[0]

    def _refuse(self, reason: str) -> NoReturn:
        """Raise ``InputError`` for a file that does not contain this hand."""
        given, allowed = f"{Path(self.path).name} {reason}", "the URDF of this hand; ng.URDFHand.load takes any other"
        raise InputError(f"hands.{self.name}.urdf", given, allowed)

    def _refuse_ambiguous(self, links: Sequence[str]) -> NoReturn:
        """Raise ``InputError`` for a file that contains several hands of this model."""
        given = f"{Path(self.path).name} with links {', '.join(links)}"
        raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")


def described_urdf(name: str) -> str:
    """Return the path of a preset's URDF in the package ``robot_descriptions``.

    Raises
    ------
    InputError
        When the package is not installed, has no URDF of this hand, or cannot fetch it.
    """
    field, description = f"hands.{name}.urdf", PRESETS[name].description
    if not description:
        raise InputError(field, "nothing", "the path of its URDF (robot_descriptions has none of this hand)")
    try:
        module = import_module(f"robot_descriptions.{description}")
    except ModuleNotFoundError:
        install = 'pip install "nlpgrasp[descriptions]"'
        raise InputError(field, "nothing", f"the path of its URDF, or robot_descriptions: {install}") from None
    except Exception as error:  # robot_descriptions clones a repository: any error of git or the network
        given = f"{description}, which robot_descriptions cannot fetch ({type(error).__name__}: {error})"
        raise InputError(field, given, "the path of its URDF") from None
    path = getattr(module, "URDF_PATH", None)
    if path is None:
        given = f"{description}, of which robot_descriptions has no plain URDF"
        raise InputError(field, given, "the path of its URDF")
    return str(path)


def _has_name(link: str, name: str) -> bool:
    """Return whether a link has a given name, with any prefix."""
    return link == name or link.endswith(tuple(f"{mark}{name}" for mark in "_:/"))


def effort_limits(robot: Robot, limits: Mapping[str, float]) -> dict[str, float]:
    """Return effort limits of the free joints, matched by the endings of their names; the file's limits for the others.

    The limit of a sliding joint counts once for each finger that the joint drives.
    """
    sliders = [robot.driving_joint(joint)[0] for joint in robot.joints if joint.kind == "prismatic"]
    result = {}
    for joint in robot.free_joints:
        if joint.effort:
            result[joint.name] = joint.effort
        for ending, limit in limits.items():
            if joint.name.endswith(ending):
                result[joint.name] = limit * (sliders.count(joint.name) if joint.kind == "prismatic" else 1)
    return result


__all__ = ["ability", "allegro", "barrett", "inspire", "jaws", "leap", "panda", "robotiq_2f85", "robotiq_3f", "shadow"]
