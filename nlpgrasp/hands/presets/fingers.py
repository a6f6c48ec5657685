"""Presets of multifingered hands with four and five fingers."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from nlpgrasp.hands.presets.preset import Options, Preset, of_urdf, same_for_all
from nlpgrasp.hands.tips import SphereTip
from nlpgrasp.hands.urdf.urdf_hand import URDFHand

ALLEGRO = Preset(
    "allegro",
    ("palm_link", "palm", "base_link"),
    {f"link_{last}.0_tip": SphereTip(0.012) for last in (3, 7, 11, 15)},
    (1.0, 0.0, 0.0),
    same_for_all(0.7),
    "allegro_hand_description",
)
LEAP = Preset(
    "leap",
    ("palm_lower",),
    {name: SphereTip(0.012, (0.0, -0.036, 0.015)) for name in ("fingertip", "fingertip_2", "fingertip_3")}
    | {"thumb_fingertip": SphereTip(0.012, (0.0, -0.048, -0.015))},
    (0.0, 0.0, -1.0),
    same_for_all(0.93),
    "leap_hand_v1_description",
)
SHADOW = Preset(
    "shadow",
    ("palm",),
    {f"{finger}distal": SphereTip(0.007, (0.0, 0.0, 0.024)) for finger in ("ff", "mf", "rf", "lf")}
    | {"thdistal": SphereTip(0.009, (0.0, 0.0, 0.026))},
    (0.0, -1.0, 0.0),
    of_urdf,
)


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
