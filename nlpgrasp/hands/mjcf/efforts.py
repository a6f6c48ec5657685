"""Effort limits of free joints by an MJCF's actuators."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.hands.mjcf.mjcf_names import joint_name
from nlpgrasp.hands.mjcf.tendons import TENDON_DRIVEN, arms_of
from nlpgrasp.hands.robot.robot import Robot

if TYPE_CHECKING:
    from mujoco import MjModel

JOINT_DRIVEN = (0, 1)  # mjtTrn: joint, joint in parent
FIXED_GAIN, NO_BIAS = 0, 0  # mjtGain, mjtBias


def with_efforts(model: MjModel, robot: Robot) -> Robot:
    """Return the robot with the largest torque (force) of each free joint, where the file states one.

    An actuator's largest force is the smaller end of its ``forcerange``, or of a motor's ``ctrlrange`` without one. By
    virtual work it counts at the free joint that its joints follow. An actuator whose tendon pulls several free joints
    counts at none of them.
    """
    joints = {joint.name: joint for joint in robot.joints}
    efforts: dict[str, float] = {}
    unknown = set()
    for a in range(model.nu):
        arms: dict[str, float] = {}
        for name, arm in _arms(model, a).items():
            if name in joints and joints[name].moves:
                driver, ratio, _ = robot.follows(joints[name])
                arms[driver] = arms.get(driver, 0.0) + ratio * arm
        force = _force(model, a)
        for driver, arm in arms.items():
            if force is None or len(arms) > 1:
                unknown.add(driver)
            else:
                efforts[driver] = efforts.get(driver, 0.0) + abs(arm) * force
    for j in range(model.njnt):
        name = joint_name(model, j)
        if name in joints and model.jnt_actfrclimited[j]:
            most = float(np.min(np.abs(model.jnt_actfrcrange[j])))
            efforts[name] = min(efforts.get(name, np.inf), most)
            unknown.discard(name)
    free = {joint.name for joint in robot.free_joints} - unknown
    stated = {name: effort for name, effort in efforts.items() if name in free}
    return replace(robot, joints=tuple(replace(j, effort=stated.get(j.name)) for j in robot.joints))


def _arms(model: MjModel, actuator: int) -> dict[str, float]:
    """Return the moment arm of an actuator at each joint: generalised force per unit of its force."""
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator][0])
    gear = float(model.actuator_gear[actuator][0])
    if kind in JOINT_DRIVEN:
        return {joint_name(model, target): gear}
    return {name: gear * arm for name, arm in arms_of(model, target).items()} if kind == TENDON_DRIVEN else {}


def _force(model: MjModel, actuator: int) -> float | None:
    """Return the force that an actuator has in both directions; None where the file does not state it."""
    if model.actuator_forcelimited[actuator]:
        return float(np.min(np.abs(model.actuator_forcerange[actuator])))
    plain = int(model.actuator_gaintype[actuator]) == FIXED_GAIN and int(model.actuator_biastype[actuator]) == NO_BIAS
    if plain and model.actuator_ctrllimited[actuator]:
        gain = abs(float(model.actuator_gainprm[actuator][0]))
        return gain * float(np.min(np.abs(model.actuator_ctrlrange[actuator])))
    return None
