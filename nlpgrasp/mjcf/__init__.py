"""A grasp as a MuJoCo scene (MJCF)."""

from nlpgrasp.mjcf.hand import mjcf_with_hand
from nlpgrasp.mjcf.scene import SceneOptions, mjcf

__all__ = [
    "SceneOptions",
    "mjcf",
    "mjcf_with_hand",
]
