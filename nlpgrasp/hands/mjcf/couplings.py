"""Coupled joints of an MJCF: linear equalities of joints and tendons as mimic joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.hands.mjcf.mjcf_joints import held
from nlpgrasp.hands.mjcf.mjcf_names import body_name, joint_name
from nlpgrasp.hands.mjcf.tendons import Tendon, tendons_of
from nlpgrasp.hands.robot.robot import Joint, Mimic, Robot
from nlpgrasp.hands.urdf.urdf_mimics import check_mimics
from nlpgrasp.hands.urdf.urdf_values import bad

if TYPE_CHECKING:
    from mujoco import MjModel

CONNECT, WELD, JOINT, TENDON = range(4)  # mjtEq
SITE = 6  # mjtObj


def coupled(path: Path, model: MjModel, robot: Robot) -> Robot:
    """Return the robot with mimic joints, and a list of the couplings that are not modelled.

    An equality of two joints makes the first follow the second. A tendon of two joints with an equality makes the later
    joint of the file follow the earlier one, where their limits leave both a range.

    Raises
    ------
    InputError
        On joints that follow another by a curve, two others, or one that is not below the palm.
    """
    active = [e for e in range(model.neq) if model.eq_active0[e]]
    for e in active:
        if int(model.eq_type[e]) == JOINT:
            robot = _followed(path, model, robot, e)
    check_mimics(path, robot.joints)
    tendons = tendons_of(model, robot)
    taken = set()
    for e in active:
        number = int(model.eq_obj1id[e])
        if int(model.eq_type[e]) == TENDON and number in tendons and int(model.eq_obj2id[e]) < 0:
            after = _tied(robot, tendons[number], float(model.eq_data[e][0]))
            if after is not None:
                robot = after
                taken.add(number)
    equal = {
        int(i) for e in active if int(model.eq_type[e]) == TENDON for i in (model.eq_obj1id[e], model.eq_obj2id[e])
    }
    left = [t.said() for i, t in tendons.items() if i not in taken and (i in equal or t.couples(robot))]
    return replace(robot, unmodelled=(*left, *_loops(model, robot, active)))


def _followed(path: Path, model: MjModel, robot: Robot, equality: int) -> Robot:
    """Return the robot after one joint equality: the joint follows another, or is fixed."""
    joints = {joint.name: joint for joint in robot.joints}
    first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    name, other = joint_name(model, first), joint_name(model, second) if second >= 0 else ""
    if name not in joints and other not in joints:
        return robot
    if name not in joints or (other and other not in joints):
        bad(path, f"joint {name} that follows {other}", "both of them below the palm")
    if joints[name].mimic is not None or not joints[name].moves:
        bad(path, f"joint {name} that follows two others", "one equality for a joint")
    a = np.array(model.eq_data[equality][:5])
    start = float(model.qpos0[model.jnt_qposadr[first]])
    if not other:
        return _with(robot, held(joints[name], start + float(a[0])))
    if np.any(a[2:]):
        bad(path, f"joint {name} that follows {other} by polycoef {a.tolist()}", "a straight line: a0 and a1 alone")
    offset = start + float(a[0] - a[1] * model.qpos0[model.jnt_qposadr[second]])
    return _with(robot, replace(joints[name], mimic=Mimic(other, float(a[1]), offset)))


def _tied(robot: Robot, tendon: Tendon, longer: float) -> Robot | None:
    """Return the robot where a tendon of fixed length makes one of its two joints follow; None where it cannot."""
    joints = {joint.name: joint for joint in robot.joints}
    if len(tendon.arms) != 2 or not all(name in joints for name in tendon.arms):
        return None
    pair = sorted(tendon.arms, key=list(joints).index)
    total = tendon.rest + longer
    for other, name in (pair, pair[::-1]):
        if joints[name].mimic is None and joints[name].moves and robot.follows(joints[other])[0] != name:
            ratio = -tendon.arms[other] / tendon.arms[name]
            after = _with(robot, replace(joints[name], mimic=Mimic(other, ratio, total / tendon.arms[name])))
            return after if all(lower < upper for lower, upper, _ in after.ranges.values()) else None
    return None


def _with(robot: Robot, joint: Joint) -> Robot:
    return replace(robot, joints=tuple(joint if j.name == joint.name else j for j in robot.joints))


def _loops(model: MjModel, robot: Robot, active: list[int]) -> list[str]:
    """Return a phrase for each closed loop: a connect or weld constraint between bodies of the hand."""
    found = []
    for e in active:
        if int(model.eq_type[e]) in (CONNECT, WELD):
            ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
            if int(model.eq_objtype[e]) == SITE:
                ends = [int(model.site_bodyid[end]) for end in ends]
            names = [body_name(model, end) for end in ends]
            if any(name in robot.links and name != robot.root for name in names):
                what = "weld" if int(model.eq_type[e]) == WELD else "connect"
                found.append(f"<{what}> of bodies {names[0]} and {names[1]}")
    return found
