"""Phase of a hand's motion: approach, pregrasp, grasp, squeeze or lift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError

APPROACH, PREGRASP, GRASP, SQUEEZE, LIFT = "approach", "pregrasp", "grasp", "squeeze", "lift"
NAMES = (APPROACH, PREGRASP, GRASP, SQUEEZE, LIFT)  # in their order


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

    @classmethod
    def of(cls, name: str, posture: Json, clearance: float | None = None) -> Phase:
        """Return the keyframe for a posture with ``palm_pose`` and ``joint_positions``."""
        pose = posture["palm_pose"]
        position, quaternion = (np.asarray(pose[key], float) for key in ("position", "quaternion_wxyz"))
        return cls(name, position, quaternion, dict(posture["joint_positions"]), clearance)


def read_phases(data: Sequence[Json], name: str) -> tuple[Phase, ...]:
    """Return the keyframes of a file; ``name`` is shown in messages.

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
