"""States of a hand (pregrasp, grasp, squeeze) for exports, with warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nlpgrasp.analysis.squeeze import squeeze_for_task
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray, metres_per, prefix_errors
from nlpgrasp.errors import InputError
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.hands.parallel_jaw import axis_name
from nlpgrasp.hands.presets import jaws
from nlpgrasp.interop.base import ExportOptions
from nlpgrasp.solution.obstructions import approach_obstructions, link_obstructions
from nlpgrasp.solution.phase_record import LIFT, PREGRASP
from nlpgrasp.solution.solution import GraspSolution

FINGER_JOINT = "finger_joint"  # default joint of parallel jaws; its position is the opening
GRIP, SAFE_GRIP = "grip_force", "grip_force_with_margin"  # normal forces of each jaw, newtons
LIMIT, FORCE_WARNING = "max_force", "force_warning"  # limit of this force, newtons, and what it does not allow
UNKNOWN_APPROACH = "the file states no way in"
NOT_ADDED = "the solve left it out"
# part of a gripper's name in public models to its preset, or to jaws in the frame of that model
KNOWN_GRIPPERS: dict[str, str | ParallelJaw] = {
    "panda": "panda",
    "franka": "panda",
    "fr3_hand": "panda",
    "robotiq_arg2f": ParallelJaw(0.085, closing_axis="y"),  # 2F-85 and 2F-140 of ROS-Industrial
    "hande": "robotiq_hande",
    "hand_e": "robotiq_hande",
    "robotiq_85_base_link": ParallelJaw(0.085),  # robotiq_description of ros2_robotiq_gripper closes along x
}
PARALLEL_TOLERANCE = 1e-3  # tolerance of parallel unit directions
MOST_NAMES = 3  # most grasps named in a warning


@dataclass(frozen=True)
class HandStates:
    """Pose, joint positions and efforts of a hand in pregrasp, grasp, squeeze and lift.

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
    gripper_frame : mapping of str to (3,) array
        ``ParallelJaw.gripper_frame`` of parallel jaws; empty for other hands.
    has_pregrasp : bool
        Whether the solution states a pregrasp; otherwise the grasp itself is used.
    blocked : str
        Why the straight approach is not free, or not known to be; empty where it is free.
    no_squeeze : str
        Why there is no squeeze; empty where there is one.
    lift_pose : (7,) array or None
        Pose after the lift; None where the solution states no lift.
    lift_joints : mapping of str to float
        Positions after the lift.
    """

    frame: str
    pose: FloatArray
    open_pose: FloatArray
    joints: Mapping[str, float]
    open_joints: Mapping[str, float]
    commands: Mapping[str, float]
    efforts: Mapping[str, float]
    approach: FloatArray | None
    gripper_frame: Mapping[str, FloatArray] = field(default_factory=dict)
    has_pregrasp: bool = True
    blocked: str = ""
    no_squeeze: str = ""
    lift_pose: FloatArray | None = None
    lift_joints: Mapping[str, float] = field(default_factory=dict)

    @property
    def has_lift(self) -> bool:
        """Whether the solution states a lift."""
        return self.lift_pose is not None

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
            allowed = "a grasp found with an ng.URDFHand or, in space, an ng.ParallelJaw"
            raise InputError(name, "no hand with a palm pose and joints", allowed)
        if "joint_positions" in hand:
            return _joint_states(solution, hand)._select_joints(joints)
        return _jaw_states(solution, hand, tuple(joints) or (FINGER_JOINT,))

    def row(self, state: str) -> FloatArray:
        """Return palm pose and joint positions of a state, (7 + j,).

        ``state`` is "pregrasp", "grasp", "squeeze" or "lift". Joints are NaN for a missing squeeze, and all entries
        for a missing lift.
        """
        if state == "lift":
            lifted = [self.lift_joints.get(name, np.nan) for name in self.joints]
            return np.concatenate([np.full(7, np.nan) if self.lift_pose is None else self.lift_pose, lifted])
        pose = self.open_pose if state == "pregrasp" else self.pose
        positions = self.open_joints if state == "pregrasp" else self.joints
        if state == "squeeze":
            unknown = dict.fromkeys(self.joints, np.nan) if self.no_squeeze else {}
            positions = {**self.joints, **self.commands, **unknown}
        return np.concatenate([pose, [positions[name] for name in self.joints]])

    def effort_row(self) -> FloatArray:
        """Return the joint torques of the squeeze, (j,).

        They are 0 for joints that move no contact, and NaN if unknown.
        """
        return np.array([self.efforts.get(name, np.nan if self.no_squeeze else 0.0) for name in self.joints])

    def _select_joints(self, names: Sequence[str]) -> HandStates:
        """Return the same states with the named joints alone, in the order of the names.

        Without names, all joints stay.
        """
        unknown = [name for name in names if name not in self.joints]
        if unknown:
            raise InputError("--joint", unknown[0], "joints of the hand: " + ", ".join(self.joints))
        if not names:
            return self

        def select(values: Mapping[str, float]) -> dict[str, float]:
            return {name: values[name] for name in names if name in values}

        return replace(
            self,
            joints=select(self.joints),
            open_joints=select(self.open_joints),
            commands=select(self.commands),
            efforts=select(self.efforts),
            lift_joints=select(self.lift_joints),
        )


def _joint_states(solution: GraspSolution, hand: Json) -> HandStates:
    """Return the states of a hand with joints."""
    phases, squeeze = {phase["name"]: phase for phase in hand.get("phases", ())}, solution.squeeze
    pregrasp: Json = hand.get("pregrasp") or hand
    if pregrasp is not hand:
        pregrasp = phases.get(PREGRASP, pregrasp)  # that of the way in, which may open less or more
    joint_squeeze = None if squeeze is None else squeeze.joints
    commands = {} if joint_squeeze is None or joint_squeeze.gain is None else joint_squeeze.positions()
    direction = (solution.problem.get("hand") or {}).get("approach")
    approach = hand.get("approach") or {}
    blocked = str(approach.get("reason") or UNKNOWN_APPROACH) if approach.get("direction") is None else ""
    lift = phases.get(LIFT)
    reasons = [*link_obstructions(hand)[:1], *([blocked] if blocked else approach_obstructions(hand))]
    return HandStates(
        solution.palm,
        _pose_vector(hand["palm_pose"]),
        _pose_vector(pregrasp["palm_pose"]),
        dict(hand["joint_positions"]),
        {name: pregrasp["joint_positions"][name] for name in hand["joint_positions"]},
        commands,
        dict(joint_squeeze.torques) if joint_squeeze is not None and commands else {},
        None if direction is None else np.asarray(direction, dtype=float),
        has_pregrasp=bool(hand.get("pregrasp")),
        blocked="; ".join(dict.fromkeys(reasons)),
        no_squeeze="" if commands else str((hand.get("no_squeeze") or {}).get("reason") or NOT_ADDED),
        lift_pose=None if lift is None else _pose_vector(lift["palm_pose"]),
        lift_joints={} if lift is None else {name: lift["joint_positions"][name] for name in hand["joint_positions"]},
    )


def _jaw_states(solution: GraspSolution, hand: Json, joints: tuple[str, ...]) -> HandStates:
    """Return the states of parallel jaws.

    The joints share the opening evenly and close with the force to set.

    Virtual work: with ``sum q_j`` the opening, each joint exerts the force between the pads, towards smaller positions.
    """
    gripper = ParallelJaw.from_dict(solution.problem["hand"])
    force, reason = _closing_force(solution)
    efforts = {} if reason else dict.fromkeys(joints, -force)
    opened = (hand.get("approach") or {}).get("opened", gripper.opening)  # as far as the way in is free
    grasp_position, open_position = hand["opening"] / len(joints), opened / len(joints)
    pose, closed_position = _pose_vector(hand["palm_pose"]), gripper.closed / len(joints)
    return HandStates(
        solution.palm,
        pose,
        pose,
        dict.fromkeys(joints, grasp_position),
        dict.fromkeys(joints, open_position),
        dict.fromkeys(joints, closed_position) if efforts else {},
        efforts,
        gripper.axes[:, 2],
        gripper.gripper_frame,
        blocked="; ".join(approach_obstructions(hand)),
        no_squeeze=reason,
    )


def _closing_force(solution: GraspSolution) -> tuple[float, str]:
    """Return the normal force to set for each jaw, newtons, or 0 with the reason why there is none.

    The reason is empty where there is a force: the least grip force, with as much of its margin as the limit allows, or
    the mean force of the squeeze for files without a grip force.
    """
    if solution.grip is not None:
        force = solution.grip.setting(solution.max_force)
        return (force, "") if solution.grip.holds else (0.0, solution.grip.warning(None))
    try:
        return float(np.mean(squeeze_for_task(solution).normal)), ""
    except InputError as error:  # contacts that cannot be squeezed
        return 0.0, str(error)


def grip_fields(solution: GraspSolution) -> dict[str, float | str]:
    """Return the known grip forces of parallel jaws, newtons, their limit and the warning on them, by name."""
    grip, limit = solution.grip, solution.max_force
    if grip is None:
        return {}
    forces = {GRIP: grip.force.upper, SAFE_GRIP: grip.with_margin.upper, LIMIT: np.inf if limit is None else limit}
    warning = grip.warning(limit)
    known = {name: value for name, value in forces.items() if np.isfinite(value)}
    return {**known, **({FORCE_WARNING: warning} if warning else {})}


def _pose_vector(data: Json) -> FloatArray:
    """Return position and quaternion of a pose, (7,)."""
    return np.array([*data["position"], *data["quaternion_wxyz"]], dtype=float)


def states_of_grasps(solution: GraspSolution, joints: Sequence[str]) -> list[tuple[GraspSolution, HandStates]]:
    """Return a solution for each kept grasp, best first, with the hand's states."""
    if solution.grasp is None:
        HandStates.of(solution, joints)  # raises the error
    solutions = [solution.with_answer(grasp) for grasp in solution.grasps]
    return [(answer, HandStates.of(answer, joints, f"grasp_{i}")) for i, answer in enumerate(solutions)]


def warn_of_axes(hand: HandStates, options: ExportOptions) -> None:
    """Warn if options name a gripper whose known axes differ from those of the exported pose.

    The sign of the closing axis does not matter: the jaws of such a gripper are symmetric.

    Parameters
    ----------
    hand : HandStates
    options : ExportOptions
        Whose ``gripper`` and ``joints`` may name a known gripper.
    """
    if not hand.gripper_frame:
        return
    closing, approach = hand.gripper_frame["closing_axis"], hand.gripper_frame["approach_axis"]
    for name in filter(None, (options.gripper, *options.joints)):
        for part, known_gripper in KNOWN_GRIPPERS.items():
            if part not in name.lower():
                continue
            gripper = known_gripper if isinstance(known_gripper, ParallelJaw) else jaws(known_gripper)
            cosines = [abs(float(gripper.axes[:, 0] @ closing)), float(gripper.axes[:, 2] @ approach)]
            if not min(cosines) >= 1.0 - PARALLEL_TOLERANCE:
                remedy = f'ng.ParallelJaw(..., closing_axis="{gripper.closing_axis}")'
                if not isinstance(known_gripper, ParallelJaw):
                    remedy = f'ng.hands.jaws("{known_gripper}") or {remedy}'
                axes = f"closes along its {gripper.closing_axis} axis and approaches along {gripper.approach_axis}"
                pose = f"the exported pose along {axis_name(closing)} and {axis_name(approach)}"
                warn(f"{name} {axes}, {pose} of the gripper's frame: solve with {remedy}")
                return


def warn_of_missing_squeezes(hands: Mapping[str, HandStates], empty: str) -> None:
    """Warn of grasps whose squeeze has not been computed.

    Parameters
    ----------
    hands : mapping of str to HandStates
        By the names of the grasps.
    empty : str
        What the export contains instead, as text.
    """
    missing = [name for name, hand in hands.items() if hand.no_squeeze == NOT_ADDED]
    if missing:
        verb = "states" if len(missing) == 1 else "state"
        warn(f"{_format_names(missing)} {verb} no squeeze, so {empty}: ng.analyse(solution, problem=problem) adds it")


def warn_of_approaches(hands: Mapping[str, HandStates]) -> None:
    """Warn of grasps without a free straight approach, in formats that have no field for it."""
    blocked = {name: hand.blocked for name, hand in hands.items() if hand.blocked}
    if blocked:
        reason = next(iter(blocked.values()))
        grasps = _format_names(list(blocked))
        warn(f"the straight way in of {grasps} is not free, so the pregrasp may not be reached: {reason}")


def approach_warning(hand: HandStates) -> str:
    """Return the reason why approach or pregrasp is unreliable, as text; empty if both are fine."""
    return hand.blocked or ("" if hand.has_pregrasp else "no pregrasp is stated: its joints are those of the grasp")


def axes_comment(hand: HandStates) -> str:
    """Return axes and tool centre point in the gripper's frame as comment lines; empty for other hands."""
    vectors = {name: [round(x, 9) for x in v.tolist()] for name, v in hand.gripper_frame.items()}
    return "".join(f"# {name} of the gripper's frame: {vector}\n" for name, vector in vectors.items())


def _format_names(names: list[str]) -> str:
    """Return names of grasps as text, at most some of them."""
    more = [f"{len(names) - MOST_NAMES} more"] if len(names) > MOST_NAMES else []
    *first, last = [*names[:MOST_NAMES], *more]
    return f"{', '.join(first)} and {last}" if first else last


def object_file(solution: GraspSolution, file: str | None) -> str:
    """Return the file of the body: the given one, or else the name of the mesh file, or else the body's type."""
    return file or str(solution.body.get("source") or solution.body.get("type", "body"))


def object_scale(solution: GraspSolution, file: str | None) -> float:
    """Return the length in metres of one unit of the exported object's file.

    It is known for the body's own mesh file, and 1 otherwise.
    """
    mesh_file, unit = solution.body.get("source"), solution.body.get("unit")
    if unit is None or (file is not None and Path(file).name != mesh_file):
        return 1.0
    return metres_per("body.unit", unit) * float(solution.body.get("scale", 1.0))
