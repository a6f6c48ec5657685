"""Keyframes of a hand's motion: approach, pregrasp, grasp, squeeze and lift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.spatial import quaternion_wxyz
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError

APPROACH, PREGRASP, GRASP, SQUEEZE, LIFT = "approach", "pregrasp", "grasp", "squeeze", "lift"
NAMES = (APPROACH, PREGRASP, GRASP, SQUEEZE, LIFT)  # in their order
OPENING = "opening"  # the joint of parallel jaws in their phases: the distance between the pads, metres
START_DISTANCE = LIFT_DISTANCE = 0.1  # metres: defaults of parallel jaws, from the grasp


@dataclass(frozen=True)
class Phase:
    """A keyframe: the hand's pose at the start of the approach, or at the end of any other phase.

    Parameters
    ----------
    name : {"approach", "pregrasp", "grasp", "squeeze", "lift"}
        Which keyframe it is.
    palm_position : (3,) array
        Of the palm's frame in the body's as it stands in the grasp, metres: in ``lift`` the body moves along.
    palm_quaternion : (4,) array
        w, x, y, z, of unit length; the same in all phases of a grasp.
    joints : mapping of str to float
        Positions of all moving joints, mimic joints included, radians or metres; in ``squeeze`` and ``lift`` the
        commands of position control.
    clearance : float or None
        Least distance of the hand from the body and the surroundings on the straight path from the previous keyframe,
        metres; None for the first one and where the fingers touch.
    """

    name: str
    palm_position: FloatArray
    palm_quaternion: FloatArray
    joints: Mapping[str, float]
    clearance: float | None = None

    @property
    def palm_frame(self) -> FloatArray:
        """The palm's frame in the body's frame, (4, 4)."""
        frame = np.eye(4)
        frame[:3, :3] = Rotation.from_quat(self.palm_quaternion, scalar_first=True).as_matrix()
        frame[:3, 3] = self.palm_position
        return frame

    def to_dict(self) -> Json:
        """Return the keyframe as JSON data, one of ``hand.phases``."""
        pose = {"position": self.palm_position.tolist(), "quaternion_wxyz": self.palm_quaternion.tolist()}
        joints = {name: float(value) for name, value in self.joints.items()}
        return {"name": self.name, "palm_pose": pose, "joint_positions": joints, "clearance": self.clearance}

    def in_frame(self, pose: FloatArray) -> Phase:
        """Return the keyframe in a world frame, given the pose (4, 4) of the body."""
        frame = pose @ self.palm_frame
        return replace(self, palm_position=frame[:3, 3], palm_quaternion=quaternion_wxyz(frame[:3, :3]))

    @classmethod
    def of(cls, name: str, posture: Json, clearance: float | None = None) -> Phase:
        """Return the keyframe of a posture, given ``palm_pose`` and ``joint_positions``."""
        pose = posture["palm_pose"]
        position, quaternion = (np.asarray(pose[key], float) for key in ("position", "quaternion_wxyz"))
        return cls(name, position, quaternion, dict(posture["joint_positions"]), clearance)


def jaw_phases(
    hand: Json, stroke: float, distance: float = START_DISTANCE, lift: float = LIFT_DISTANCE
) -> tuple[Phase, ...]:
    """Return the keyframes of parallel jaws, with the opening as their joint: approach, pregrasp, grasp, lift.

    The gripper comes in along its stated approach, as far open as is free there, closes, and rises along the last axis
    of the body's frame, the table's normal.

    Parameters
    ----------
    hand : mapping
        The gripper's JSON data in a solution: ``palm_pose``, ``opening`` and ``approach``.
    stroke : float
        Opening on an approach that states none, metres.
    distance, lift : float
        Lengths of approach and lift, metres.
    """
    approach = hand["approach"]
    opened = {OPENING: float(approach.get("opened", stroke))}
    grasp = Phase.of(GRASP, {"palm_pose": hand["palm_pose"], "joint_positions": {OPENING: hand["opening"]}})
    back, up = -distance * np.asarray(approach["direction"], dtype=float), np.array([0.0, 0.0, lift])
    return (
        replace(grasp, name=APPROACH, palm_position=grasp.palm_position + back, joints=opened),
        replace(grasp, name=PREGRASP, joints=opened, clearance=approach.get("clearance")),
        grasp,
        replace(grasp, name=LIFT, palm_position=grasp.palm_position + up),
    )


def read_phases(data: Sequence[Json], name: str) -> tuple[Phase, ...]:
    """Return the keyframes in a file's data.

    ``name`` is shown in messages.

    Raises
    ------
    InputError
        On names out of order, or other joints in one than in another.
    """
    phases = []
    for i, entry in enumerate(data):
        field, pose = f"{name}[{i}]", entry["palm_pose"]
        joints = {str(j): number(f"{field}.joint_positions.{j}", v) for j, v in entry["joint_positions"].items()}
        clearance = entry.get("clearance")
        phases.append(
            Phase(
                str(entry["name"]),
                array(f"{field}.palm_pose.position", pose["position"], (3,)),
                array(f"{field}.palm_pose.quaternion_wxyz", pose["quaternion_wxyz"], (4,)),
                joints,
                None if clearance is None else number(f"{field}.clearance", clearance),
            )
        )
        if list(joints) != list(phases[0].joints):
            raise InputError(f"{field}.joint_positions", ", ".join(joints), ", ".join(phases[0].joints))
    names = [phase.name for phase in phases]
    if names != [name for name in NAMES if name in names]:
        raise InputError(f"{name}.name", ", ".join(names), f"each at most once, in the order {', '.join(NAMES)}")
    return tuple(phases)
