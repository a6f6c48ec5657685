"""MuJoCo scenes (MJCF) of grasps."""

from nlpgrasp.mjcf.hand_scene import HandSceneOptions, mjcf_with_hand
from nlpgrasp.mjcf.scene import SceneOptions, mjcf

__all__ = [
    "HandSceneOptions",
    "SceneOptions",
    "mjcf",
    "mjcf_with_hand",
]
