"""MJCF joints between a body and its parent, several in series, each about its own anchor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.mjcf.mjcf_names import body_name, joint_name
from nlpgrasp.hands.robot.robot import Joint
from nlpgrasp.hands.urdf.urdf_values import bad

if TYPE_CHECKING:
    from mujoco import MjModel

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint


def joints_to(path: Path, model: MjModel, body: int) -> list[Joint]:
    """Return the joints from a body's parent to the body; several are chained by links without shapes.

    With anchor a and axis u in the body's frame a hinge moves what is below it by ``T(a) R(u, q - q0) T(-a)``, after
    the joints before it: each joint's frame stands in its anchor. Joints without a range have infinite limits here.

    Raises
    ------
    InputError
        On ball and free joints.
    """
    name, parent = body_name(model, body), body_name(model, int(model.body_parentid[body]))
    here = transform(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    result: list[Joint] = []
    for j in range(first, first + count):
        kind, label = int(model.jnt_type[j]), joint_name(model, j)
        if kind in (FREE, BALL):
            cure = (
                f"hinges and slides below the palm, or palm={name!r}" if kind == FREE else "three hinges in its place"
            )
            bad(path, f"joint {label} of body {name}, of type {('free', 'ball')[kind]}", cure)
        anchor, axis, reference = (
            model.jnt_pos[j],
            np.array(model.jnt_axis[j]),
            float(model.qpos0[model.jnt_qposadr[j]]),
        )
        back = transform(-anchor)
        here = here @ transform(anchor) @ moved(kind == SLIDE, axis, -reference)
        last = j == first + count - 1 and not np.any(anchor)
        child = name if last else f"{name}/{label}"
        lower, upper = (float(v) for v in model.jnt_range[j]) if model.jnt_limited[j] else (-np.inf, np.inf)
        xyz, rpy = here[:3, 3].copy(), angles(here[:3, :3])
        what = "prismatic" if kind == SLIDE else "revolute"
        result.append(Joint(label, what, parent, child, xyz, rpy, axis, lower, upper))
        here, parent = back, child
    if parent != name:
        xyz, rpy, axis = here[:3, 3].copy(), angles(here[:3, :3]), np.array([1.0, 0.0, 0.0])
        result.append(Joint(f"{name}/fixed", "fixed", parent, name, xyz, rpy, axis, 0.0, 0.0))
    return result


def held(joint: Joint, position: float) -> Joint:
    """Return the joint fixed at a position, radians or metres."""
    here = transform(joint.xyz)
    here[:3, :3] = Rotation.from_euler("xyz", joint.rpy).as_matrix()
    there = here @ moved(joint.kind == "prismatic", joint.axis, position)
    return replace(joint, kind="fixed", xyz=there[:3, 3].copy(), rpy=angles(there[:3, :3]), lower=0.0, upper=0.0)


def closed(path: Path, joint: Joint) -> Joint:
    """Return the joint with finite limits: a hinge without a range turns half a turn either way.

    Raises
    ------
    InputError
        On slides without a range that follow no other joint.
    """
    if not joint.moves or joint.mimic is not None or np.isfinite(joint.upper):
        return joint
    if joint.kind == "prismatic":
        bad(path, f"joint {joint.name}, a slide without range", "range= on every slide")
    return replace(joint, kind="continuous", lower=-np.pi, upper=np.pi)


def transform(position: FloatArray, quaternion: FloatArray | None = None) -> FloatArray:
    """Return the (4, 4) transform of a position (3,) and a quaternion (4,) w, x, y, z."""
    pose = np.eye(4)
    pose[:3, 3] = position
    if quaternion is not None:
        pose[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return pose


def moved(slides: bool, axis: FloatArray, position: float) -> FloatArray:
    """Return the (4, 4) motion of a joint along, or about, an axis (3,) through the origin."""
    pose = np.eye(4)
    if slides:
        pose[:3, 3] = position * axis
    else:
        pose[:3, :3] = Rotation.from_rotvec(position * axis).as_matrix()
    return pose


def angles(rotation: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (3,) of a rotation (3, 3), accurate near the singularity too."""
    yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    rest = Rotation.from_euler("z", -yaw).as_matrix() @ rotation  # = Ry(pitch) Rx(roll)
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])
