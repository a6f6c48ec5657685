"""Fingertip geometries: the patch of a link that may touch the body."""

from nlpgrasp.hands.tips.base import Tip, Touch
from nlpgrasp.hands.tips.capsule import CapsuleTip
from nlpgrasp.hands.tips.cylinder import CylinderTip
from nlpgrasp.hands.tips.ellipsoid import EllipsoidTip
from nlpgrasp.hands.tips.flat import FlatTip
from nlpgrasp.hands.tips.sphere import SphereTip

__all__ = ["CapsuleTip", "CylinderTip", "EllipsoidTip", "FlatTip", "SphereTip", "Tip", "Touch"]
