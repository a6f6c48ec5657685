"""Keyframes of a grasp's phases: palm and joint positions, and servo set-points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.mjcf.hand_scene.hand_bodies import ARM, PREFIX
from nlpgrasp.mjcf.parts import numbers
from nlpgrasp.solution.squeezed.squeeze import Squeeze

LIFT = 0.2  # m, along z, if the file has no phases
HELD = ("squeeze", "lift")  # phases in which set-points differ from joint positions, to exert torques


@dataclass(frozen=True)
class Keyframe:
    """A keyframe: palm displacement, joint positions and servo set-points of a phase.

    Parameters
    ----------
    name : str
    moved : (3,) array
        Displacement of the palm from the grasp, metres, body frame.
    joints : mapping of str to float
        Positions of all moving joints, radians or metres.
    told : mapping of str to float
        Set-points of the free joints' servos.
    """

    name: str
    moved: FloatArray
    joints: Mapping[str, float]
    told: Mapping[str, float]


def keyframes(hand: Json, robot: Robot, squeeze: Squeeze, gains: Mapping[str, float], scale: float) -> list[Keyframe]:
    """Return the keyframes of a grasp in chronological order.

    Parameters
    ----------
    hand : mapping
        ``hand`` of a solution file.
    robot : Robot
    squeeze : Squeeze
    gains : mapping of str to float
        Of the joints' position control.
    scale : float
        Factor on the squeeze: 2 presses twice as hard.
    """
    here, free = hand["joint_positions"], [joint.name for joint in robot.free_joints]
    pressed = {name: here[name] + scale * tau / gains[name] for name, tau in squeeze.torques.items()}
    result = []
    for phase in _phases(hand):
        moved = np.asarray(phase["palm_pose"]["position"], float) - hand["palm_pose"]["position"]
        held = phase["name"] in HELD
        joints = here if held else phase["joint_positions"]
        told = {name: joints[name] for name in free} | (pressed if held else {})
        result.append(Keyframe(str(phase["name"]), moved, joints, told))
    return result


def add_keyframes(root: Element, frames: Sequence[Keyframe]) -> None:
    """Add keyframes with states and controls to a scene, with the object lifted with the palm in the lift."""
    order = [joint.get("name", "") for joint in root.iter("joint") if joint.get("name")]
    motors = [motor.get("name", "") for motor in root.iter("position")]
    keyframe = SubElement(root, "keyframe")
    for frame in frames:
        arm = dict(zip(ARM, frame.moved, strict=True))
        carried = frame.moved if frame.name == "lift" else np.zeros(3)
        where = arm | {PREFIX + name: value for name, value in frame.joints.items()}
        told = arm | {PREFIX + name: value for name, value in frame.told.items()}
        state = [*carried, 1.0, 0.0, 0.0, 0.0, *(where[name] for name in order if name in where)]
        controls = numbers(told[name] for name in motors)
        SubElement(keyframe, "key", name=frame.name, qpos=numbers(state), ctrl=controls)


def _phases(hand: Json) -> list[Json]:
    """Return the phases of a file; for earlier versions, phases derived from its data."""
    if hand.get("phases"):
        return list(hand["phases"])
    here = {"palm_pose": hand["palm_pose"], "joint_positions": hand["joint_positions"]}
    x, y, z = hand["palm_pose"]["position"]
    raised = {**here, "palm_pose": {**hand["palm_pose"], "position": [x, y, z + LIFT]}}
    before = hand.get("pregrasp")
    opened = [] if before is None else [{**before, "name": "pregrasp"}]
    return [*opened, {**here, "name": "grasp"}, {**here, "name": "squeeze"}, {**raised, "name": "lift"}]


def gains_of(robot: Robot, squeeze: Squeeze, gain: float | None) -> dict[str, float]:
    """Return the position gain of each free joint: the squeeze's, or a given one for revolute joints.

    Raises
    ------
    InputError
        If the squeeze states none.
    """
    stated = None if squeeze.joints is None else squeeze.joints.gain
    if stated is None:
        raise InputError("hand.squeeze.gain", None, "a squeeze with the gain of the joints' position control")
    by_joint = stated if isinstance(stated, Mapping) else {}
    usual = max(by_joint.values(), default=0.0) if isinstance(stated, Mapping) else stated
    result = {}
    for joint in robot.free_joints:
        own = by_joint.get(joint.name, usual)
        result[joint.name] = gain if gain is not None and joint.turns else own
    return result
