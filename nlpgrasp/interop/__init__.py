"""Import and export of grasps in the formats of other tools."""

from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need, ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.contacts_csv import contacts_csv
from nlpgrasp.interop.contacts_table import read_contacts_csv
from nlpgrasp.interop.glb import glb
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, isaac_grasp, read_isaac_grasps
from nlpgrasp.interop.placed_hand import grasp_of_posture
from nlpgrasp.interop.registry import register, register_reader
from nlpgrasp.interop.robots.benchmark import benchmark_arrays, dexgraspbench
from nlpgrasp.interop.robots.moveit import moveit

__all__ = [
    "ExportFormat",
    "ExportOptions",
    "IsaacGrasp",
    "Need",
    "ReadFormat",
    "ReadGrasp",
    "ReadOptions",
    "benchmark_arrays",
    "contacts_csv",
    "dexgraspbench",
    "glb",
    "grasp_of_posture",
    "isaac_grasp",
    "moveit",
    "read_contacts_csv",
    "read_isaac_grasps",
    "register",
    "register_reader",
]
