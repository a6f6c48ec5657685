"""Hands of the repository for tests, and forward kinematics by MuJoCo."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np

import nlpgrasp as ng

FOLDER = Path(__file__).resolve().parents[2] / "problems" / "hands"
FOUR, THREE, GRIPPER = (
    FOLDER / f"{name}.urdf" for name in ("four_finger_hand", "three_finger_hand", "parallel_gripper")
)
FOUR_TIPS = {f"{finger}_tip": 0.011 for finger in ("index", "middle", "ring", "thumb")}
THREE_TIPS = {f"finger_{i}_tip": 0.01 for i in (1, 2, 3)}
SETTINGS = '<mujoco><compiler fusestatic="false" balanceinertia="true" discardvisual="true"/></mujoco>'
PADS = {"left_pad": ng.FlatTip([0.02, 0.02]), "right_pad": ng.FlatTip([0.02, 0.02])}


@cache
def four_finger_hand(**options):
    return ng.URDFHand.load(FOUR, FOUR_TIPS, approach=[1.0, 0.0, 0.0], **options)


@cache
def three_finger_hand(**options):
    return ng.URDFHand.load(THREE, THREE_TIPS, **options)


@cache
def gripper(**options):
    return ng.URDFHand.load(GRIPPER, PADS, **options)


class Mujoco:
    """The kinematics of a URDF by MuJoCo, which shares no code with the package."""

    def __init__(self, path):
        self.model = mujoco.MjModel.from_xml_string(path.read_text().replace("</robot>", f"{SETTINGS}</robot>"))
        self.data = mujoco.MjData(self.model)

    def link_poses(self, joint_positions):
        """Return the pose (4, 4) of every link in the root's frame, for joint positions by name."""
        for name, value in joint_positions.items():
            joint = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
            self.data.qpos[self.model.jnt_qposadr[joint]] = value
        mujoco.mj_kinematics(self.model, self.data)
        poses = {}
        for i in range(1, self.model.nbody):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self.data.xmat[i].reshape(3, 3), self.data.xpos[i]
            poses[mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, i)] = pose
        return poses


def body_frame(palm_pose):
    """Return the (4, 4) transform of a solution's palm pose."""
    w, x, y, z = palm_pose["quaternion_wxyz"]
    result = np.zeros(9)
    mujoco.mju_quat2Mat(result, np.array([w, x, y, z]))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = result.reshape(3, 3), palm_pose["position"]
    return pose


def solution_links(path, hand_data):
    """Return the links' poses in the body's frame, from a solution's JSON data of the hand alone."""
    base = body_frame(hand_data["palm_pose"])
    return {name: base @ pose for name, pose in Mujoco(path).link_poses(hand_data["joint_positions"]).items()}


def link_distances(path, hand_data, geom, position=(0.0, 0.0, 0.0)):
    """Return the distance of each link with shapes from a geom by MuJoCo, metres, at most 50 mm.

    Parameters
    ----------
    hand_data : dict
        ``palm_pose`` and ``joint_positions``, as in a solution's JSON data.
    geom : dict
        ``type`` and ``size`` of the geom.
    position : (3,) array
        Of the geom in the body's frame, metres.
    """
    frame = np.linalg.inv(body_frame(hand_data["palm_pose"]))
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, frame[:3, :3].ravel())
    spec = mujoco.MjSpec.from_string(path.read_text().replace("</robot>", f"{SETTINGS}</robot>"))
    spec.worldbody.add_geom(name="the body", pos=frame[:3] @ [*position, 1.0], quat=quaternion, **geom)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in hand_data["joint_positions"].items():
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    body, result = model.geom("the body").id, {}
    for i in range(model.ngeom):
        if i != body:
            link = model.body(model.geom_bodyid[i]).name
            result[link] = min(result.get(link, 0.05), mujoco.mj_geomDistance(model, data, i, body, 0.05, None))
    return result
