"""Poses of a gripper's tool centre point for a robot: approach, grasp and retreat."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.files import check_regular_file, parse_json
from nlpgrasp.common.spatial import Pose, check_cell_positions, pose_matrix, quaternion_wxyz
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need
from nlpgrasp.solution.obstructions import approach_obstructions
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, LIFT_DISTANCE, START_DISTANCE, jaw_phases
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.trajectory import frame_columns, require_jaws

FREE = "free"
TOOL_POSE = "the poses are those of the tool centre point, turned as the gripper's own frame"
JAWS = "a grasp found with an ng.ParallelJaw in space"  # what poses require
PART_FRAME, CELL_FRAME = "part", "cell"  # names of the frames of the poses: without and with a stated pose of the part
RETREAT = "retreat"
PART_POSE = tuple(f"part_{name}" for name in ("x", "y", "z", "qw", "qx", "qy", "qz"))  # columns: pose of the part
SAME_FRAME = 1e-6  # largest difference of two poses that are one frame
# columns of a pose: position in metres, unit quaternion, rotation vector in radians
COORDINATES = ("x", "y", "z", "qw", "qx", "qy", "qz", "rx", "ry", "rz")


@dataclass(frozen=True)
class ToolPose:
    """Pose of a gripper's tool centre point, with the axes of the gripper's frame.

    The tool centre point is the middle between the pads.

    ``str`` is the pose as robot controllers write it, ``p[x, y, z, rx, ry, rz]``: metres, and the rotation vector.

    Parameters
    ----------
    matrix : (4, 4) array
        ``[[R, t], [0, 1]]``, metres.
    """

    matrix: FloatArray

    @property
    def position(self) -> FloatArray:
        """Position of the tool centre point, (3,), metres."""
        return np.asarray(self.matrix[:3, 3])

    @property
    def quaternion_wxyz(self) -> FloatArray:
        """Orientation as a unit quaternion w, x, y, z, (4,), with w at least zero."""
        return quaternion_wxyz(self.matrix[:3, :3])

    @property
    def rotation_vector(self) -> FloatArray:
        """Orientation as axis times angle, (3,), radians, at most pi long."""
        return np.asarray(Rotation.from_matrix(self.matrix[:3, :3]).as_rotvec())

    def __str__(self) -> str:
        values = [*self.position.tolist(), *self.rotation_vector.tolist()]
        return "p[" + ", ".join(f"{value + 0.0:.7g}" for value in np.round(values, 9)) + "]"

    @property
    def row(self) -> list[float]:
        """Position, quaternion and rotation vector as the cells of a table row."""
        return [*self.position.tolist(), *self.quaternion_wxyz.tolist(), *self.rotation_vector.tolist()]

    def to_dict(self) -> Json:
        """Return the pose as JSON data in several forms: matrix, quaternion, rotation vector and text."""
        return {
            "matrix": self.matrix.tolist(),
            "position": self.position.tolist(),
            "quaternion_wxyz": self.quaternion_wxyz.tolist(),
            "rotation_vector": self.rotation_vector.tolist(),
            "text": str(self),
        }


@dataclass(frozen=True)
class RobotPoses:
    """Poses in which a robot grasps a part: approach, grasp and retreat, with opening and force.

    Parameters
    ----------
    approach, grasp, retreat : ToolPose
        Of the tool centre point before the straight approach, in the grasp, and with the part after it.
    opened, opening : float
        Between the pads on the approach and in the grasp, metres.
    force : float or None
        Normal force of each jaw to set, newtons, with its margin as far as the limit allows; None where none holds.
    max_force : float or None
        Limit of this force, newtons; None without one.
    force_warning : str
        What the limit does not allow, or that no force holds the task; empty where the force has its margin.
    clearance : float or None
        Least clearance of the gripper on its way in, metres; None for a gripper without stated sizes.
    way_in : str
        ``"free"``, or what is in the way.
    mu : float
        Certified lower bound of the grasp's quality.
    """

    approach: ToolPose
    grasp: ToolPose
    retreat: ToolPose
    opened: float
    opening: float
    force: float | None
    max_force: float | None
    force_warning: str
    clearance: float | None
    way_in: str
    mu: float

    @property
    def is_free(self) -> bool:
        """Whether the approach is unobstructed."""
        return self.way_in == FREE

    def to_dict(self) -> Json:
        """Return poses, opening, force with its limit, and clearance as JSON data."""
        poses = {name: pose.to_dict() for name, pose in self._poses.items()}
        names = ("opened", "opening", "force", "max_force", "force_warning", "clearance", "way_in", "mu")
        return {**poses, **{name: getattr(self, name) for name in names}}

    @property
    def _poses(self) -> dict[str, ToolPose]:
        return {APPROACH: self.approach, GRASP: self.grasp, RETREAT: self.retreat}


def robot_poses(
    solution: GraspSolution,
    frame: Pose | None = None,
    distance: float = START_DISTANCE,
    retreat: float = LIFT_DISTANCE,
) -> tuple[RobotPoses, ...]:
    """Return the robot poses of every kept grasp of a parallel gripper, best first.

    Parameters
    ----------
    solution : GraspSolution
        With a grasp in space by an ``ng.ParallelJaw``.
    frame : (4, 4) array or mapping, optional
        Pose of the part in the robot's cell, as ``GraspSolution.in_frame`` takes it; by default poses are in the
        part's own frame.
    distance : float
        From the approach pose straight to the grasp, metres. The way in is checked over twice the part's size.
    retreat : float
        From the grasp along the last axis of the part's frame, the table's normal, metres. Where the gripper comes in
        along this axis, its way back is checked; the part's own way is not.

    Raises
    ------
    InputError
        Without such a grasp, on a frame that is no pose or puts the gripper more than 10 m away, and on lengths below
        zero.
    """
    gripper = require_jaws(solution, JAWS)
    part_pose = np.eye(4) if frame is None else pose_matrix("frame", frame)
    lengths = number("distance", distance, at_least=0.0), number("retreat", retreat, at_least=0.0)
    to_tcp = np.eye(4)
    to_tcp[:3, 3] = gripper.tool_centre_point

    def poses_of(answer: GraspSolution) -> RobotPoses:
        hand, grip = answer.hand or {}, answer.grip
        tools = {
            phase.name: ToolPose(part_pose @ phase.palm_frame @ to_tcp)
            for phase in jaw_phases(hand, gripper.opening, *lengths)
        }
        if frame is not None:
            check_cell_positions("frame", [tool.position for tool in tools.values()])
        return RobotPoses(
            tools[APPROACH],
            tools[GRASP],
            tools[LIFT],
            opened=float(hand["approach"].get("opened", gripper.opening)),
            opening=float(hand["opening"]),
            force=grip.setting(answer.max_force) if grip is not None and grip.holds else None,
            max_force=answer.max_force,
            force_warning=answer.grip_warning,
            clearance=hand["approach"].get("clearance"),
            way_in="; ".join(approach_obstructions(hand)) or FREE,
            mu=answer.mu.lower,
        )

    return tuple(poses_of(solution.with_answer(grasp)) for grasp in solution.grasps)


def _poses_table(solution: GraspSolution, options: ExportOptions) -> str:
    """Return the robot poses of all kept grasps as CSV text.

    Every row states its frame, the part's pose in it, and the axes and tool centre point in the gripper's own frame.
    """
    axes = frame_columns(require_jaws(solution, JAWS).gripper_frame)
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    heads = [f"{name}_{coordinate}" for name in (APPROACH, GRASP, RETREAT) for coordinate in COORDINATES]
    settings = ("opened", "opening", "force", "max_force", "force_warning", "clearance")
    writer.writerow([GRASP, "frame", "way_in", *settings, "mu", *heads, *axes, *PART_POSE])
    frame = PART_FRAME if options.frame is None else CELL_FRAME
    part_pose = ToolPose(np.eye(4) if options.frame is None else options.frame).row[: len(PART_POSE)]
    for i, poses in enumerate(robot_poses(solution, options.frame)):
        values = ["" if (value := getattr(poses, name)) is None else value for name in settings]
        coordinates = [*poses.approach.row, *poses.grasp.row, *poses.retreat.row]
        writer.writerow([i, frame, poses.way_in, *values, poses.mu, *coordinates, *axes.values(), *part_pose])
    return text.getvalue()


def _poses_json(solution: GraspSolution, options: ExportOptions) -> str:
    """Return the robot poses of all kept grasps as JSON text, with their frames."""
    gripper = require_jaws(solution, JAWS)
    data = {
        "frame": PART_FRAME if options.frame is None else CELL_FRAME,
        "part_pose": (np.eye(4) if options.frame is None else options.frame).tolist(),
        **{name: vector.tolist() for name, vector in gripper.gripper_frame.items()},
        "grasps": [poses.to_dict() for poses in robot_poses(solution, options.frame)],
    }
    return json.dumps(data, allow_nan=False, indent=1) + "\n"


def check_one_frame(target: Path, export_format: ExportFormat, frame: FloatArray | None) -> None:
    """Raise if a file with poses would be written over one, or into a folder with some, in another frame.

    Parameters
    ----------
    target : Path
        To be written.
    export_format : ExportFormat
        Others than the two of poses are not looked at.
    frame : (4, 4) array, optional
        The part's pose in the frame of the poses; None for the part's own frame.
    """
    if export_format not in (POSES, POSES_JSON):
        return
    wanted = np.eye(4) if frame is None else frame
    there = (file for kind in (POSES, POSES_JSON) for file in target.parent.glob(f"*{kind.ending}"))
    for file in sorted({target, *there}):
        pose = _stated_part_pose(file)
        if pose is not None and not np.allclose(pose, wanted, rtol=0.0, atol=SAME_FRAME):
            allowed = "a folder whose poses are all in one frame, or --out in another folder"
            raise InputError(f"out ({target})", f"{file.name} in another frame is there", allowed)


def _stated_part_pose(file: Path) -> FloatArray | None:
    """Return the pose of the part (4, 4) that a file with poses states; None for a file of another kind."""
    try:
        check_regular_file(file, "a file with poses")
        text = file.read_text(encoding="utf-8")
        if text.startswith("{"):
            return pose_matrix("part_pose", parse_json(text)["part_pose"])
        row = next(csv.DictReader(io.StringIO(text)))
        values = [float(row[name]) for name in PART_POSE]
        return pose_matrix("part_pose", {"position": values[:3], "quaternion_wxyz": values[3:]})
    except (OSError, ValueError, KeyError, TypeError, StopIteration, InputError):
        return None


POSES = ExportFormat(
    *("poses", ".poses.csv", "a table of a gripper's poses for a robot", _poses_table, Need.NOTHING),
    takes=("frame",),
    has_all_grasps=True,
    pose=TOOL_POSE,
)
POSES_JSON = ExportFormat(
    *("poses_json", ".poses.json", "the same as JSON, with matrices", _poses_json, Need.NOTHING),
    takes=("frame",),
    has_all_grasps=True,
    pose=TOOL_POSE,
)
