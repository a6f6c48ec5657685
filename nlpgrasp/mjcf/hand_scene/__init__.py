"""A grasp as a MuJoCo scene that runs: the object, the hand's own links and joints, keyframes of all phases."""

from nlpgrasp.mjcf.hand_scene.options import HandSceneOptions
from nlpgrasp.mjcf.hand_scene.scene import mjcf_with_hand

__all__ = ["HandSceneOptions", "mjcf_with_hand"]
