"""Dynamic MuJoCo scene of a grasp: object, articulated hand and keyframes of all phases."""

from nlpgrasp.mjcf.hand_scene.options import HandSceneOptions
from nlpgrasp.mjcf.hand_scene.scene import mjcf_with_hand

__all__ = ["HandSceneOptions", "mjcf_with_hand"]
