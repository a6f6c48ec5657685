"""Trajectory of a hand through the keyframes of a grasp, sampled in time."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from nlpgrasp.common.spatial import Pose, check_cell_positions, pose_matrix
from nlpgrasp.common.validation import FloatArray, IntArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.solution.phase_record import jaw_phases
from nlpgrasp.solution.record_fields import LEFT_OUT, Matrix, Record, Vector
from nlpgrasp.solution.solution import GraspSolution

RATE, SPEED, JOINT_SPEED = 50.0, 0.1, 0.5  # defaults: samples per second, m/s of the palm, rad/s of joints
JAW_SPEED = 0.05  # m/s: default speed of the opening of parallel jaws
# columns of the palm's pose in a table of the trajectory
PALM = ("palm_x", "palm_y", "palm_z", "palm_qw", "palm_qx", "palm_qy", "palm_qz")


@dataclass(frozen=True)
class Trajectory(Record):
    """Hand trajectory: straight between the keyframes of ``solution.phases``, each leg at constant speeds.

    Parameters
    ----------
    times : (m,) array
        Seconds, from 0.
    phases : tuple of m str
        The current phase: that of the next keyframe.
    palm_positions : (m, 3) array
        Metres, in the frame of the body as it stands in the grasp, or in the frame that was asked for.
    palm_quaternion : (4,) array
        w, x, y, z, constant.
    joint_names : tuple of n str
        All moving joints, mimic joints included; ``opening`` of parallel jaws, the distance between the pads.
    joints : (m, n) array
        Radians or metres.
    closing_axis, approach_axis, tcp : (3,) array, optional
        Of parallel jaws, in the gripper's own frame, whose pose the palm's is: unit directions, and the middle between
        the pads, metres.
    """

    times: Vector
    phases: tuple[str, ...]
    palm_positions: Matrix
    palm_quaternion: Vector = field(metadata={"key": "palm_quaternion_wxyz"})
    joint_names: tuple[str, ...]
    joints: Matrix
    closing_axis: Vector | None = field(default=None, metadata=LEFT_OUT)
    approach_axis: Vector | None = field(default=None, metadata=LEFT_OUT)
    tcp: Vector | None = field(default=None, metadata=LEFT_OUT)

    def to_csv(self) -> str:
        """Return the trajectory as CSV text with time, phase, palm position and quaternion, and joints.

        Of parallel jaws, the last columns of every row are axes and tool centre point.
        """
        vectors = {"closing_axis": self.closing_axis, "approach_axis": self.approach_axis, "tcp": self.tcp}
        axes = frame_columns({name: vector for name, vector in vectors.items() if vector is not None})
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(["time", "phase", *PALM, *self.joint_names, *axes])
        turn = self.palm_quaternion.tolist()
        for time, phase, palm, joints in zip(self.times, self.phases, self.palm_positions, self.joints, strict=True):
            writer.writerow([float(time), phase, *palm.tolist(), *turn, *joints.tolist(), *axes.values()])
        return text.getvalue()


def trajectory(
    solution: GraspSolution,
    rate: float = RATE,
    speed: float = SPEED,
    joint_speed: float | Mapping[str, float] | None = None,
    frame: Pose | None = None,
) -> Trajectory:
    """Return the hand's trajectory through the phases of a grasp: approach, pregrasp, grasp, squeeze, lift.

    Palm and joints move on straight lines between keyframes, those that were checked for collisions, and arrive
    together: the slowest sets the pace. Every keyframe is a sample; samples are at most ``1 / rate`` seconds apart.
    Parallel jaws come in from 0.1 m, close, and rise by 0.1 m.

    Parameters
    ----------
    solution : GraspSolution
        With ``phases``, or with a grasp in space by an ``ng.ParallelJaw``.
    rate : float
        Samples a second, at least.
    speed : float
        Speed of the palm, metres per second.
    joint_speed : float or mapping of str to float, optional
        Speed of the joints, radians per second (metres per second for sliding joints), for all or by joint; by default
        0.5, and 0.05 for the opening of parallel jaws.
    frame : (4, 4) array or mapping, optional
        Pose of the body in the frame of the trajectory, as ``GraspSolution.in_frame`` takes it; by default the body's.

    Raises
    ------
    InputError
        On a solution without phases, numbers that are not above zero, and a frame that is no pose or puts the hand
        more than 10 m away.
    """
    frames, default_speed, axes = solution.phases, JOINT_SPEED, {}
    if not frames:
        gripper = require_jaws(solution, "a grasp with a URDF hand or, in space, an ng.ParallelJaw")
        frames, default_speed = jaw_phases(solution.hand or {}, gripper.opening), JAW_SPEED
        axes = gripper.gripper_frame
    if frame is not None:
        pose = pose_matrix("frame", frame)
        frames = tuple(phase.in_frame(pose) for phase in frames)
        check_cell_positions("frame", [phase.palm_position for phase in frames])
    rate, speed = number("rate", rate, above=0.0), number("speed", speed, above=0.0)
    names = tuple(frames[0].joints)
    fastest = _speeds(default_speed if joint_speed is None else joint_speed, names)
    joints = [np.array([frame.joints[name] for name in names]) for frame in frames]
    durations = [
        max(float(np.linalg.norm(b.palm_position - a.palm_position)) / speed, float(np.max(abs(r - q) / fastest)))
        for (a, b), (q, r) in zip(pairwise(frames), pairwise(joints), strict=True)
    ]
    times, start_frames, fractions = _sample_legs(durations, rate)
    end_frames = np.minimum(start_frames + 1, len(frames) - 1)
    phases = (frames[0].name, *(frames[i].name for i in end_frames[1:]))
    palms, postures = np.array([frame.palm_position for frame in frames]), np.array(joints)
    return Trajectory(
        times,
        phases,
        (1.0 - fractions) * palms[start_frames] + fractions * palms[end_frames],
        frames[0].palm_quaternion,
        names,
        (1.0 - fractions) * postures[start_frames] + fractions * postures[end_frames],
        **axes,
    )


def frame_columns(vectors: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the columns of a table and their values that state ``ParallelJaw.gripper_frame``: ``tcp_x``, ..."""
    named = ((name, zip("xyz", vector.tolist(), strict=True)) for name, vector in vectors.items())
    return {f"{name}_{coordinate}": value for name, cells in named for coordinate, value in cells}


def require_jaws(solution: GraspSolution, allowed: str) -> ParallelJaw:
    """Return the parallel jaws of a spatial grasp, or raise ``InputError`` if it has none.

    Raises
    ------
    InputError
        Without such a grasp, with ``allowed`` as what was expected.
    """
    data, pose = solution.problem.get("hand") or {}, (solution.hand or {}).get("palm_pose")
    if solution.grasp is None or data.get("type") != ParallelJaw.kind or pose is None:
        raise InputError("solution", "no phases of a hand", allowed)
    return ParallelJaw.from_dict(data)


def _sample_legs(durations: Sequence[float], rate: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return samples of consecutive motions: times (m,), index of the motion (m,), completed fraction (m, 1).

    The first sample is the start of the first leg; all others end at most ``1 / rate`` seconds after the previous one.

    Parameters
    ----------
    durations : sequence of float
        Of the legs, seconds.
    rate : float
        Samples a second, at least.
    """
    fractions, legs, times = [np.zeros(1)], [0], [np.zeros(1)]
    for i, duration in enumerate(durations):
        count = max(int(np.ceil(duration * rate)), 1)
        fractions.append(np.arange(1, count + 1) / count)
        times.append(times[-1][-1] + fractions[-1] * duration)
        legs += [i] * count
    return np.concatenate(times), np.array(legs, dtype=np.intp), np.concatenate(fractions)[:, None]


def _speeds(joint_speed: float | Mapping[str, float], names: tuple[str, ...]) -> FloatArray:
    """Return the speeds of the joints, (n,), validated to be above zero."""
    if not isinstance(joint_speed, Mapping):
        return np.full(len(names), number("joint_speed", joint_speed, above=0.0))
    missing = [name for name in names if name not in joint_speed]
    if missing:
        raise InputError("joint_speed", f"none of joint {missing[0]}", "a speed for every joint that moves")
    return np.array([number(f"joint_speed of {name}", joint_speed[name], above=0.0) for name in names])
