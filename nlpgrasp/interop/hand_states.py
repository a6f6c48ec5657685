"""Pose and joints of a hand before, in and after closing, with warnings for exports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.analysis.squeeze import squeeze_for_task
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import UNITS, FloatArray, prefix_errors
from nlpgrasp.errors import InputError
from nlpgrasp.hands.parallel_jaw import APPROACH_AXIS, CLOSING_AXIS, axis_direction, gripper_rotation, named
from nlpgrasp.interop.base import ExportOptions
from nlpgrasp.solution.obstructions import approach_obstructions, grasp_obstructions
from nlpgrasp.solution.solution import GraspSolution

FINGER_JOINT = "finger_joint"  # default joint of parallel jaws; its position is the opening
UNKNOWN_WAY = "the file states no way in"
NOT_ADDED = "the solve left it out"
CLOSING_AXES = {  # part of a gripper's name in public models to its closing axis, base frame
    "panda": "y",  # franka_description: both fingers slide along y of panda_hand or fr3_hand
    "franka": "y",
    "fr3_hand": "y",
    "robotiq_arg2f": "y",  # robotiq_2f_85_gripper_visualization of ROS-Industrial
    "robotiq_85_base_link": "x",  # robotiq_description of ros2_robotiq_gripper
}
ALONG = 1e-3  # tolerance of parallel unit directions
MOST = 3  # most grasps named in a warning


@dataclass(frozen=True)
class HandStates:
    """Pose and joints of a hand in pregrasp, grasp and squeeze.

    Parameters
    ----------
    frame : str
        Link of the pose.
    pose, open_pose : (7,) array
        Pose of that link in the body's frame, in the grasp and in the pregrasp: metres, then a unit quaternion, w
        first. For parallel jaws that of the gripper's own frame.
    joints, open_joints : mapping of str to float
        Positions in the grasp and in the pregrasp, radians (metres for sliding joints).
    commands : mapping of str to float
        Position commands of the squeeze, for the joints that it moves.
    efforts : mapping of str to float
        Torques of these joints in the squeeze, newton-metres (newtons for sliding joints); positive towards larger
        positions. Empty without a squeeze.
    approach : (3,) array or None
        Unit direction in which the hand moves to the body, in its own frame; None if unknown.
    closing : (3,) array or None
        Unit direction from jaw to jaw in the gripper's own frame, for parallel jaws.
    has_pregrasp : bool
        Whether the solution states a pregrasp; otherwise the grasp itself is used.
    blocked : str
        Why the straight approach is not free, or not known to be; empty where it is free.
    no_squeeze : str
        Why there is no squeeze; empty where there is one.
    """

    frame: str
    pose: FloatArray
    open_pose: FloatArray
    joints: Mapping[str, float]
    open_joints: Mapping[str, float]
    commands: Mapping[str, float]
    efforts: Mapping[str, float]
    approach: FloatArray | None
    closing: FloatArray | None = None
    has_pregrasp: bool = True
    blocked: str = ""
    no_squeeze: str = ""

    @classmethod
    def of(cls, solution: GraspSolution, joints: Sequence[str] = (), name: str = "solution") -> HandStates:
        """Return the states of a solution's hand.

        Parameters
        ----------
        solution : GraspSolution
        joints : sequence of str
            For a hand with joints, those to export, in this order; for parallel jaws, those that share the opening
            evenly, by default ``finger_joint`` alone.
        name : str
            Of the grasp, for messages.

        Raises
        ------
        InputError
            Without a grasp or a hand with a pose; on a joint that the hand does not have.
        """
        hand = solution.hand or {}
        with prefix_errors(f"{name}: "):
            solution.require_grasp()
        if not solution.is_certified or "palm_pose" not in hand:
            found = "a grasp found with an ng.URDFHand or, in space, an ng.ParallelJaw"
            raise InputError(name, "no hand with a palm pose and joints", found)
        if "joint_positions" in hand:
            return _joint_states(solution, hand)._chosen(joints)
        return _jaw_states(solution, hand, tuple(joints) or (FINGER_JOINT,))

    def row(self, at: str) -> FloatArray:
        """Return pose and joints, (7 + j,), ``at`` "pregrasp", "grasp" or "squeeze"; NaN without a squeeze."""
        pose = self.open_pose if at == "pregrasp" else self.pose
        positions = self.open_joints if at == "pregrasp" else self.joints
        if at == "squeeze":
            unknown = dict.fromkeys(self.joints, np.nan) if self.no_squeeze else {}
            positions = {**self.joints, **self.commands, **unknown}
        return np.concatenate([pose, [positions[name] for name in self.joints]])

    def effort_row(self) -> FloatArray:
        """Return the joint torques of the squeeze, (j,): 0 for joints that move no contact; NaN if unknown."""
        return np.array([self.efforts.get(name, np.nan if self.no_squeeze else 0.0) for name in self.joints])

    def axes(self) -> dict[str, FloatArray]:
        """Return closing and approach axis in the gripper's own frame by name, (3,) each; empty for other hands."""
        if self.closing is None or self.approach is None:
            return {}
        return {"closing_axis": self.closing, "approach_axis": self.approach}

    def _chosen(self, names: Sequence[str]) -> HandStates:
        """Return the states with the named joints alone, in their order; with all if none are named."""
        unknown = [name for name in names if name not in self.joints]
        if unknown:
            raise InputError("--joint", unknown[0], "joints of the hand: " + ", ".join(self.joints))
        if not names:
            return self

        def of(values: Mapping[str, float]) -> dict[str, float]:
            return {name: values[name] for name in names if name in values}

        return replace(
            self,
            joints=of(self.joints),
            open_joints=of(self.open_joints),
            commands=of(self.commands),
            efforts=of(self.efforts),
        )


def _joint_states(solution: GraspSolution, hand: Json) -> HandStates:
    """Return the states of a hand with joints."""
    opened, held = hand.get("pregrasp") or hand, solution.squeeze
    exerted = None if held is None else held.joints
    commands = {} if exerted is None or exerted.gain is None else exerted.positions()
    direction = (solution.problem.get("hand") or {}).get("approach")
    way = hand.get("approach") or {}
    blocked = str(way.get("reason") or UNKNOWN_WAY) if way.get("direction") is None else ""
    blocked = "; ".join([*grasp_obstructions(hand)[:1], *([blocked] if blocked else approach_obstructions(hand))])
    return HandStates(
        solution.palm,
        _pose_vector(hand["palm_pose"]),
        _pose_vector(opened["palm_pose"]),
        dict(hand["joint_positions"]),
        {name: opened["joint_positions"][name] for name in hand["joint_positions"]},
        commands,
        dict(exerted.torques) if exerted is not None and commands else {},
        None if direction is None else np.asarray(direction, dtype=float),
        has_pregrasp=bool(hand.get("pregrasp")),
        blocked=blocked,
        no_squeeze="" if commands else str((hand.get("no_squeeze") or {}).get("reason") or NOT_ADDED),
    )


def _jaw_states(solution: GraspSolution, hand: Json, joints: tuple[str, ...]) -> HandStates:
    """Return the states of parallel jaws, whose joints share the opening evenly and close with the squeeze's force.

    Virtual work: with ``sum q_j`` the opening, each joint exerts the force between the pads, towards smaller positions.
    """
    asked = solution.problem["hand"]
    try:
        force = float(np.mean(squeeze_for_task(solution).normal))
    except InputError as error:  # contacts that cannot be squeezed
        efforts, why = {}, str(error)
    else:
        efforts, why = dict.fromkeys(joints, -force), ""
    opening, most = hand["opening"] / len(joints), asked["opening"] / len(joints)
    pose, closed = _pose_vector(hand["palm_pose"]), asked["closed"] / len(joints)
    axes = gripper_rotation(asked.get("closing_axis", CLOSING_AXIS), asked.get("approach_axis", APPROACH_AXIS))
    return HandStates(
        solution.palm,
        pose,
        pose,
        dict.fromkeys(joints, opening),
        dict.fromkeys(joints, most),
        dict.fromkeys(joints, closed) if efforts else {},
        efforts,
        axes[:, 2],
        axes[:, 0],
        blocked="; ".join(approach_obstructions(hand)),
        no_squeeze=why,
    )


def _pose_vector(data: Json) -> FloatArray:
    """Return position and quaternion of a pose, (7,)."""
    return np.array([*data["position"], *data["quaternion_wxyz"]], dtype=float)


def states_of_grasps(solution: GraspSolution, joints: Sequence[str]) -> list[tuple[GraspSolution, HandStates]]:
    """Return every kept grasp as a solution of its own, best first, with its hand states."""
    if solution.grasp is None:
        HandStates.of(solution, joints)  # raises the error
    alone = [solution.with_answer(found) for found in solution.grasps]
    return [(one, HandStates.of(one, joints, f"grasp_{i}")) for i, one in enumerate(alone)]


def warn_of_axes(hand: HandStates, options: ExportOptions) -> None:
    """Warn where options name a gripper whose known closing axis differs from that of the pose.

    The sign does not matter: the jaws of such a gripper are symmetric.

    Parameters
    ----------
    hand : HandStates
    options : ExportOptions
        Whose ``gripper`` and ``joints`` may name a known gripper.
    """
    if hand.closing is None:
        return
    for name in filter(None, (options.gripper, *options.joints)):
        for part, axis in CLOSING_AXES.items():
            if part in name.lower() and not abs(float(axis_direction("axis", axis) @ hand.closing)) >= 1.0 - ALONG:
                stated = named(hand.closing)
                text = f"{name} closes along its {axis} axis, the exported pose along {stated} of the gripper's frame"
                warn(f'{text}: solve with ng.ParallelJaw(..., closing_axis="{axis}")')
                return


def warn_of_squeezes(hands: Mapping[str, HandStates], empty: str) -> None:
    """Warn of grasps without a squeeze.

    Parameters
    ----------
    hands : mapping of str to HandStates
        By the names of the grasps.
    empty : str
        What the export contains instead, as text.
    """
    left = [name for name, hand in hands.items() if hand.no_squeeze == NOT_ADDED]
    if left:
        stated = "states" if len(left) == 1 else "state"
        warn(
            f"{_format_joint_names(left)} {stated} no squeeze, so {empty}: "
            "ng.analyse(solution, problem=problem) adds it"
        )


def warn_of_ways(hands: Mapping[str, HandStates]) -> None:
    """Warn of grasps without a free straight approach, for formats without a field for it."""
    blocked = {name: hand.blocked for name, hand in hands.items() if hand.blocked}
    if blocked:
        first = next(iter(blocked.values()))
        grasps = _format_joint_names(list(blocked))
        warn(f"the straight way in of {grasps} is not free, so the pregrasp may not be reached: {first}")


def approach_warning(hand: HandStates) -> str:
    """Return the reason why approach or pregrasp is unreliable, as text; empty where both are fine."""
    return hand.blocked or ("" if hand.has_pregrasp else "no pregrasp is stated: its joints are those of the grasp")


def axes_comment(hand: HandStates) -> str:
    """Return the axes of a gripper's own frame as a comment line; empty for other hands."""
    axes = {name: [round(x, 9) for x in (axis + 0.0).tolist()] for name, axis in hand.axes().items()}
    return "".join(f"# {name} of the gripper's frame: {axis}\n" for name, axis in axes.items())


def _format_joint_names(names: list[str]) -> str:
    more = [f"{len(names) - MOST} more"] if len(names) > MOST else []
    *first, last = [*names[:MOST], *more]
    return f"{', '.join(first)} and {last}" if first else last


def object_file(solution: GraspSolution, given: str | None) -> str:
    """Return the given file of the body, else the name of its mesh file, else its type."""
    return given or str(solution.body.get("source") or solution.body.get("type", "body"))


def object_scale(solution: GraspSolution, given: str | None) -> float:
    """Return metres per unit of the file's coordinates: the unit of the body's own mesh file, else 1."""
    own, unit = solution.body.get("source"), solution.body.get("unit")
    if unit not in UNITS or (given is not None and Path(given).name != own):
        return 1.0
    return UNITS[unit]
