"""Export of grasps as ``moveit_msgs/Grasp`` messages for MoveIt.

Field names are those of https://github.com/moveit/moveit_msgs (``msg/Grasp.msg``, ``msg/GripperTranslation.msg``) and
of the ROS 2 messages in them. Omitted fields have their defaults: stamps, velocities of points.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import yaml

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need
from nlpgrasp.interop.hand_states import (
    HandStates,
    approach_warning,
    axes_comment,
    states_of_grasps,
    warn_of_approaches,
    warn_of_axes,
    warn_of_missing_squeezes,
)
from nlpgrasp.solution.obstructions import GRIPPER_POSE
from nlpgrasp.solution.solution import GraspSolution

OBJECT_FRAME = "object"  # default name of the body's frame
DESIRED_DISTANCE, LEAST_DISTANCE = 0.1, 0.05  # metres of approach and retreat: desired and least
POSTURE_SECONDS = 1  # seconds to the only point of a posture's trajectory


def moveit(solution: GraspSolution, options: ExportOptions | None = None) -> str:
    """Return the kept grasps as a list of ``moveit_msgs/Grasp`` messages in YAML, best first.

    ``grasp_quality`` is the certified lower bound of mu, ``effort`` the joint torques of the squeeze, of parallel jaws
    the grip force with its margin, within the limit; ``max_contact_force`` is the limit or 0 (none). Comments before
    the list state a gripper's axes and tool centre point, the force to set it to for each grasp with its limit, and
    which grasps have no free approach, as the messages have no field for them.

    Parameters
    ----------
    solution : GraspSolution
        With a hand that has a pose and joints.
    options : ExportOptions, optional
        ``object`` names the body's frame, ``gripper`` the hand's, ``joints`` the joints.

    Raises
    ------
    InputError
        Without such a hand, or where its direction of approach is not known.

    Warns
    -----
    UserWarning
        On a gripper that closes along another axis, and on grasps without a squeeze or a free approach.
    """
    export_options = options or ExportOptions()
    states = {f"grasp_{i}": state for i, state in enumerate(states_of_grasps(solution, export_options.joints))}
    messages = [_message(name, grasp_solution, hand, export_options) for name, (grasp_solution, hand) in states.items()]
    hands = {name: hand for name, (_, hand) in states.items()}
    best_hand = hands["grasp_0"]
    warn_of_axes(best_hand, export_options)
    warn_of_missing_squeezes(hands, "its grasp_posture has no effort")
    warn_of_approaches(hands)
    blocked = {name: reason for name, hand in hands.items() if (reason := approach_warning(hand))}
    comments = "".join(f"# {name}: way in not free: {' '.join(reason.split())}\n" for name, reason in blocked.items())
    text = yaml.safe_dump(messages, sort_keys=False, default_flow_style=None, width=120)
    grips = {
        name: [grasp_solution.grip_line(), grasp_solution.grip_warning] for name, (grasp_solution, _) in states.items()
    }
    forces = "".join(f"# {name}: {line}\n" for name, lines in grips.items() for line in lines if line)
    return f"{axes_comment(best_hand)}{forces}{comments}{text}"


def _message(name: str, solution: GraspSolution, hand: HandStates, options: ExportOptions) -> Json:
    """Return one grasp as the data of a ``moveit_msgs/Grasp`` message."""
    if hand.approach is None:
        raise InputError(name, "no direction of approach", "a solution of this version, whose hand states it")
    body_frame, hand_frame = options.object or OBJECT_FRAME, options.gripper or hand.frame
    x, y, z, *quaternion = hand.pose.tolist()
    orientation = dict(zip("wxyz", quaternion, strict=True))
    return {
        "id": name,
        "pre_grasp_posture": _posture(hand.open_joints, {}),
        "grasp_posture": _posture(hand.joints, hand.efforts),
        "grasp_pose": {
            "header": {"frame_id": body_frame},
            "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": orientation},
        },
        "grasp_quality": float(solution.mu.lower),
        "pre_grasp_approach": _translation(hand_frame, hand.approach),
        "post_grasp_retreat": _translation(body_frame, np.array([0.0, 0.0, 1.0])),
        "post_place_retreat": _translation(hand_frame, -hand.approach),
        "max_contact_force": float(solution.max_force or 0.0),
        "allowed_touch_objects": [],
    }


def _posture(positions: Mapping[str, float], efforts: Mapping[str, float]) -> Json:
    """Return a ``trajectory_msgs/JointTrajectory`` of one point.

    Joints without a stated torque have effort 0.
    """
    point = {
        "positions": [float(position) for position in positions.values()],
        "velocities": [],
        "accelerations": [],
        "effort": [float(efforts.get(name, 0.0)) for name in positions] if efforts else [],
        "time_from_start": {"sec": POSTURE_SECONDS, "nanosec": 0},
    }
    return {"header": {"frame_id": ""}, "joint_names": list(positions), "points": [point]}


def _translation(frame: str, direction: FloatArray) -> Json:
    """Return the data of a ``moveit_msgs/GripperTranslation`` along a direction."""
    vector = dict(zip("xyz", (direction + 0.0).tolist(), strict=True))
    return {
        "direction": {"header": {"frame_id": frame}, "vector": vector},
        "desired_distance": DESIRED_DISTANCE,
        "min_distance": LEAST_DISTANCE,
    }


MOVEIT = ExportFormat(
    *("moveit", ".grasps.yaml", "MoveIt's messages", moveit, Need.NOTHING),
    takes=("object", "gripper", "joints"),
    has_all_grasps=True,
    pose=GRIPPER_POSE,
)
