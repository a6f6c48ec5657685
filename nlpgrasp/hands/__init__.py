"""Hands: fingertips, parallel jaws and robot hands from URDF or MJCF files."""

from nlpgrasp.hands.base import Hand, HandVariable, PosedHand
from nlpgrasp.hands.fingertips import Fingertips
from nlpgrasp.hands.parallel_jaw import ParallelJaw
from nlpgrasp.hands.presets import (
    ability,
    allegro,
    barrett,
    inspire,
    jaws,
    leap,
    panda,
    robotiq_2f85,
    robotiq_3f,
    shadow,
)
from nlpgrasp.hands.registry import hand_from_dict, register
from nlpgrasp.hands.tips import CapsuleTip, CylinderTip, EllipsoidTip, FlatTip, HullTip, SphereTip, Tip
from nlpgrasp.hands.urdf_hand import URDFHand

__all__ = [
    "CapsuleTip",
    "CylinderTip",
    "EllipsoidTip",
    "Fingertips",
    "FlatTip",
    "Hand",
    "HandVariable",
    "HullTip",
    "ParallelJaw",
    "PosedHand",
    "SphereTip",
    "Tip",
    "URDFHand",
    "ability",
    "allegro",
    "barrett",
    "hand_from_dict",
    "inspire",
    "jaws",
    "leap",
    "panda",
    "register",
    "robotiq_2f85",
    "robotiq_3f",
    "shadow",
]
