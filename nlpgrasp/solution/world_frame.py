"""Grasp of a solution in a world frame, given the pose of the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.spatial import Pose, pose_matrix, rigid_transform, rotate_body_frame
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, read_only
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.phase_record import Phase
from nlpgrasp.tasks import Task


@dataclass(frozen=True)
class SolutionInFrame:
    """Grasp of a solution in a world frame, given the pose of the body.

    It serves display and planning; the file and ``ng.verify`` use the solution in the body's frame.

    Parameters
    ----------
    name : str
        The problem's.
    pose : (space + 1, space + 1) array
        ``[[A, b], [0, 1]]``: a point x of the body is at ``A x + b``, metres.
    grasp : Grasp
        Contacts and normals in the world frame; moments about the same point of the body.
    faces : tuple of str
        The face each contact is on.
    task : Task
        The required wrenches, about the grasp's torque origin.
    mu : Bounds
        Certified quality of the grasp: the same in every frame, (3.3-7a).
    forces : tuple of (wrench, forces)
        Task wrenches (d,) and finger forces (k, space), newtons.
    palm_pose : (4, 4) array or None
        Of the hand's palm, or the gripper's frame; None of hands without one.
    joints : mapping of str to float
        Joint positions, radians or metres; empty without joints.
    phases : tuple of Phase
        The keyframes of the hand, palm positions and quaternions in this frame.
    """

    name: str
    pose: FloatArray
    grasp: Grasp
    faces: tuple[str, ...]
    task: Task
    mu: Bounds
    forces: tuple[tuple[FloatArray, FloatArray], ...]
    palm_pose: FloatArray | None
    joints: Mapping[str, float]
    phases: tuple[Phase, ...]

    def __repr__(self) -> str:
        return f"SolutionInFrame({self.name!r}, {len(self.grasp)} contacts, mu in {self.mu})"


def transform_grasp(
    name: str,
    pose: Pose,
    grasp: Grasp,
    faces: tuple[str, ...],
    task: Task,
    mu: Bounds,
    forces: Sequence[tuple[FloatArray, FloatArray]],
    hand: Json | None,
    phases: Sequence[Phase],
) -> SolutionInFrame:
    """Return a solution's grasp in a world frame, given the pose of the body.

    The arguments except ``pose`` are the solution's.

    Raises
    ------
    InputError
        When the pose is no rotation and translation of the grasp's space.
    """
    space = grasp.space
    A, b = rigid_transform("pose", pose, space)
    matrix = np.eye(space + 1)
    matrix[:space, :space], matrix[:space, space] = A, b
    map_of_wrenches = rotate_body_frame(A)
    palm_pose = None if hand is None else hand.get("palm_pose")
    return SolutionInFrame(
        name,
        read_only(matrix),
        grasp.in_frame(matrix),
        faces,
        task.about(grasp.torque_origin).in_frame(matrix),
        mu,
        tuple((map_of_wrenches @ wrench, finger_forces @ A.T) for wrench, finger_forces in forces),
        None if palm_pose is None else matrix @ pose_matrix("hand.palm_pose", palm_pose),
        dict((hand or {}).get("joint_positions") or {}),
        tuple(phase.in_frame(matrix) for phase in phases),
    )
