"""Link trees of MJCF hands, and MuJoCo's frames of their bodies."""

import mujoco
import numpy as np

from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.tips import SphereTip


def tree_of(robot):
    """Return the kinematics of all links that are bodies of the file."""
    tips = [(link, SphereTip(0.01)) for link in robot.links if "/" not in link]
    return LinkTree(robot, tips, np.array([0.0, 0.0, 1.0]))


def frames(path, positions, palm):
    """Return the bodies' frames in the palm's, (4, 4), by MuJoCo itself."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    result = {}
    for body in range(1, model.nbody):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
        result[model.body(body).name or f"body_{body}"] = frame
    inverse = np.linalg.inv(result[palm])
    return {name: inverse @ frame for name, frame in result.items()}
