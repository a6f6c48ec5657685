"""A MuJoCo scene of a grasp with the hand itself: its URDF model, its joints, keyframes of grasp and pregrasp."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.mjcf.scene import mjcf_of_object
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeezed.joints import GAIN

if TYPE_CHECKING:
    from mujoco import MjModel, MjsFrame, MjSpec

PREFIX = "hand_"


def mjcf_with_hand(solution: GraspSolution, urdf: str | Path) -> str:
    """Return the scene with the hand's own model, fixed at its palm, as MJCF text.

    MuJoCo reads the URDF itself. Keyframe ``grasp`` has the joints and motors where the grasp is, ``pregrasp`` where
    the fingertips are still off the object, which is free and collides as its convex hull.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``.
    urdf : path
        The hand's file: the one the problem was solved with.

    Raises
    ------
    InputError
        Without such a hand, on another hand's file, or one that MuJoCo cannot read.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    mujoco = import_mujoco("a scene with the hand")
    posture = solution.hand or {}
    if "palm_pose" not in posture or "joint_positions" not in posture:
        raise InputError("solution", "no hand with a palm pose and joints", "a grasp found with an ng.URDFHand")
    palm = solution.palm
    spec = mujoco.MjSpec.from_string(mjcf_of_object(solution))
    hand = _read(mujoco, urdf)
    names = {j.name for j in hand.joints}
    missing = sorted(set(posture["joint_positions"]) - names)
    if missing or palm not in {b.name for b in hand.bodies}:
        raise InputError(str(urdf), f"no {'joint ' + missing[0] if missing else 'link ' + palm}", "the solution's hand")
    frame = spec.worldbody.add_frame()
    neighbours = [(b.name, child.name) for b in hand.bodies if b.name != "world" for child in b.bodies]
    spec.attach(hand, prefix=PREFIX, frame=frame)
    for first, second in neighbours:  # MuJoCo itself leaves out neighbours, but not those of a fixed palm
        spec.add_exclude(bodyname1=PREFIX + first, bodyname2=PREFIX + second)
    for joint in posture["joint_positions"]:
        motor = spec.add_actuator(name=f"{PREFIX}{joint}", target=f"{PREFIX}{joint}")
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0], motor.biasprm[1] = GAIN, -GAIN
    _place(mujoco, spec, frame, palm, posture)
    model = spec.compile()
    for name, there in (("grasp", posture), ("pregrasp", posture.get("pregrasp"))):
        if there is not None:
            joints = there["joint_positions"]
            control = [joints[model.actuator(i).name.removeprefix(PREFIX)] for i in range(model.nu)]
            spec.add_key(name=name, qpos=_positions(model, joints).tolist(), ctrl=control)
    spec.compile()
    return str(spec.to_xml())


def _read(mujoco: ModuleType, urdf: str | Path) -> MjSpec:
    """Return the hand's model, its meshes by absolute paths."""
    if not Path(urdf).is_file():
        raise InputError("--hand", str(urdf), "the hand's URDF file")
    try:
        hand = mujoco.MjSpec.from_file(str(urdf))
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(str(urdf), " ".join(str(error).split()), "a URDF file that MuJoCo can read") from None
    hand.compiler.fusestatic = False  # every link stays a body of its own
    for mesh in hand.meshes:
        file = Path(urdf).parent / hand.meshdir / mesh.file
        if file.is_file():
            mesh.file = str(file.resolve())
    return hand


def _place(mujoco: ModuleType, spec: MjSpec, frame: MjsFrame, palm: str, posture: Json) -> None:
    """Move the hand's frame to where its palm comes to the palm's pose."""
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError("--hand", " ".join(str(error).split()), "a URDF file that MuJoCo can compile") from None
    data = mujoco.MjData(model)
    data.qpos[:] = _positions(model, posture["joint_positions"])
    mujoco.mj_kinematics(model, data)
    here = data.body(f"{PREFIX}{palm}")
    turned, back, wanted = np.zeros(4), np.zeros(4), np.array(posture["palm_pose"]["quaternion_wxyz"])
    mujoco.mju_negQuat(back, here.xquat)
    mujoco.mju_mulQuat(turned, wanted, back)
    moved = np.zeros(3)
    mujoco.mju_rotVecQuat(moved, here.xpos, turned)
    frame.pos = np.array(posture["palm_pose"]["position"]) - moved
    frame.quat = turned


def _positions(model: MjModel, joints: Mapping[str, float]) -> FloatArray:
    """Return the scene's coordinates: the object in its place, the hand's joints as given."""
    q = np.array(model.qpos0)
    for name, value in joints.items():
        q[model.joint(f"{PREFIX}{name}").qposadr[0]] = value
    return q
