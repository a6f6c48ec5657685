"""Grasps for other tools, and from them."""

from nlpgrasp.interop.contacts_csv import contacts_csv, read_contacts_csv
from nlpgrasp.interop.glb import glb
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, isaac_grasp, read_isaac_grasps

__all__ = ["IsaacGrasp", "contacts_csv", "glb", "isaac_grasp", "read_contacts_csv", "read_isaac_grasps"]
