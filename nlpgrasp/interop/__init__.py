"""Import and export of grasps in the formats of other tools."""

from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need, ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.benchmark_arrays import benchmark_arrays, dexgraspbench
from nlpgrasp.interop.contacts_csv import contacts_csv, read_contacts_csv
from nlpgrasp.interop.glb import glb
from nlpgrasp.interop.grasp_tables import read_grasp_stacks, read_grasps
from nlpgrasp.interop.hand_postures import grasp_of_posture
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, isaac_grasp, read_isaac_grasps
from nlpgrasp.interop.moveit import moveit
from nlpgrasp.interop.registry import register, register_reader
from nlpgrasp.interop.robot_poses import RobotPoses, ToolPose, robot_poses

__all__ = [
    "ExportFormat",
    "ExportOptions",
    "IsaacGrasp",
    "Need",
    "ReadFormat",
    "ReadGrasp",
    "ReadOptions",
    "RobotPoses",
    "ToolPose",
    "benchmark_arrays",
    "contacts_csv",
    "dexgraspbench",
    "glb",
    "grasp_of_posture",
    "isaac_grasp",
    "moveit",
    "read_contacts_csv",
    "read_grasp_stacks",
    "read_grasps",
    "read_isaac_grasps",
    "register",
    "register_reader",
    "robot_poses",
]
