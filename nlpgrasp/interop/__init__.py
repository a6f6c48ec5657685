"""Grasps for other tools, and from them."""

from nlpgrasp.interop.contacts_csv import contacts_csv, read_contacts_csv
from nlpgrasp.interop.glb import glb
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, isaac_grasp, read_isaac_grasps
from nlpgrasp.interop.placed_hand import grasp_of_posture
from nlpgrasp.mjcf.hand import mjcf_with_hand
from nlpgrasp.mjcf.scene import mjcf

__all__ = [
    "IsaacGrasp",
    "contacts_csv",
    "glb",
    "grasp_of_posture",
    "isaac_grasp",
    "mjcf",
    "mjcf_with_hand",
    "read_contacts_csv",
    "read_isaac_grasps",
]
