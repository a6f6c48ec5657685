"""Presets of common hands: fingertips, approach and effort limits for their URDFs."""

from nlpgrasp.hands.presets.fingers import allegro, leap, shadow
from nlpgrasp.hands.presets.grippers import barrett, panda, robotiq_2f85, robotiq_3f

PRESETS = {make.__name__: make for make in (allegro, barrett, leap, panda, robotiq_2f85, robotiq_3f, shadow)}

__all__ = ["allegro", "barrett", "leap", "panda", "robotiq_2f85", "robotiq_3f", "shadow"]
