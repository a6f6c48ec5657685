"""Exported poses of two parallel grippers, checked with the makers' robot files in MuJoCo.

The Panda's URDF (``make robots``) has boxes for the fingers and a link at the tool centre point; that of the Robotiq
2F-85, with the joints of the ROS-Industrial description, has its pads. The pads are opened as far as exported.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from tests.hands.robotiq import BASE, robotiq_2f85
from tests.hands.robots import robot

COMPILER = (
    '<mujoco><compiler fusestatic="false" discardvisual="true" strippath="false" balanceinertia="true"/></mujoco>'
)
PACKAGE = "package://example-robot-data/robots"
FARTHEST = 0.2  # metres: largest distance that is measured
OPENED = 1e-3  # metres by which each pad is opened in the check of the closing axis
HALVINGS = 40  # of the range of the joints
AWAY = (9.0, 9.0, 9.0)  # metres: the part's position while the opening is set
LINKAGE = {
    f"{side}_inner_{name}_joint": s for side in ("left", "right") for name, s in (("finger", -1), ("knuckle", 1))
}


def least_distance(model, data, geoms, others):
    """Return the least signed distance between two sets of geoms by index, metres, at most ``FARTHEST``."""
    return min(mujoco.mj_geomDistance(model, data, i, j, FARTHEST, None) for i in geoms for j in others)


class GripperFile:
    """A gripper's robot file in MuJoCo, with a part that is placed between its pads.

    Parameters
    ----------
    path : Path
        Of the URDF.
    pads : sequence of str
        Links of the pads.
    frame : str
        Link whose frame a pose states.
    joints : mapping
        Rate of each joint's position with the one that is set.
    closed, opened : float
        Positions of the joint that is set, with the pads together and apart.
    pieces : list of (n, 3) arrays
        Corners of the part's convex pieces, metres.
    """

    def __init__(self, path, pads, frame, joints, closed, opened, pieces):
        text = path.read_text().replace(PACKAGE, str(path.parents[2]))
        spec = mujoco.MjSpec.from_string(text.replace("</robot>", COMPILER + "</robot>"))
        part = spec.worldbody.add_body(name="part", mocap=True)
        for i, corners in enumerate(pieces):
            spec.add_mesh(name=f"piece_{i}", uservert=corners.ravel())
            part.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"piece_{i}")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.frame, self.joints, self.range = frame, joints, (closed, opened)
        self.pads, self.part = [self._geoms(name) for name in pads], self._geoms("part")

    def _geoms(self, link):
        """Return the numbers of a link's geoms."""
        return np.flatnonzero(self.model.geom_bodyid == self.model.body(link).id).tolist()

    def _distance(self, geoms, others):
        """Return the least signed distance between two sets of geoms, metres."""
        return least_distance(self.model, self.data, geoms, others)

    def _open(self, opening):
        """Open the pads to a distance, metres."""
        closed, opened = self.range
        for _ in range(HALVINGS):
            middle = 0.5 * (closed + opened)
            for name, rate in self.joints.items():
                self.data.joint(name).qpos[0] = rate * middle
            mujoco.mj_kinematics(self.model, self.data)
            is_wide = self._distance(*self.pads) > opening
            closed, opened = (closed, middle) if is_wide else (middle, opened)

    def distances(self, matrix, opening):
        """Return the signed distances of both pads from the part, (2,), metres.

        Parameters
        ----------
        matrix : (4, 4) array
            Pose of the frame's link in the part's frame.
        opening : float
            Between the pads, metres.
        """
        self.data.mocap_pos[0] = AWAY
        self._open(opening)
        link, pose = self.data.body(self.frame), np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.array(link.xmat).reshape(3, 3), link.xpos
        pose = pose @ np.linalg.inv(matrix)
        self.data.mocap_pos[0] = pose[:3, 3]
        mujoco.mju_mat2Quat(self.data.mocap_quat[0], pose[:3, :3].ravel())
        mujoco.mj_kinematics(self.model, self.data)
        return np.array([self._distance(pad, self.part) for pad in self.pads])


def panda(pieces):
    """Return the Panda by its URDF, and the pose of its link at the tool centre point against the exported one."""
    path, joints = robot("panda_description/urdf/panda.urdf"), {f"panda_finger_joint{i}": 1.0 for i in (1, 2)}
    links = "panda_leftfinger", "panda_rightfinger"
    return GripperFile(path, links, "panda_hand_tcp", joints, 0.0, 0.04, pieces), np.eye(4)


def robotiq(pieces):
    """Return the Robotiq 2F-85 by its URDF, and the pose of its base against the exported tool centre point."""
    joints = {"finger_joint": 1.0, "right_outer_knuckle_joint": 1.0, **LINKAGE}
    links = "left_inner_finger_pad", "right_inner_finger_pad"
    base = np.eye(4)
    base[:3, 3] = -ng.hands.jaws("robotiq_2f85").tool_centre_point
    with TemporaryDirectory() as folder:
        path = robotiq_2f85(Path(folder) / "robotiq_2f85.urdf")
        return GripperFile(path, links, BASE, joints, 0.8, 0.0, pieces), base


FILES = {"panda": panda, "robotiq_2f85": robotiq}


def check(name, solution, pieces):
    """Return the largest distance of a pad from the part, and the largest error of a millimetre's opening, metres."""
    gripper, link = FILES[name](pieces)
    off, opened = [], []
    for poses in ng.robot_poses(solution):
        matrix = poses.grasp.matrix @ link
        off.append(gripper.distances(matrix, poses.opening))
        opened.append(gripper.distances(matrix, poses.opening + 2.0 * OPENED) - OPENED)
    return float(np.max(np.abs(off))), float(np.max(np.abs(opened)))


def report(name, solution, pieces):
    """Print the distances of a preset's pads by its robot file, where there is one."""
    try:
        off, opened = check(name, solution, pieces)
    except pytest.skip.Exception as reason:
        print(f"{name}: {reason}")
        return
    distances = f"pads off by at most {1e3 * off:.3f} mm, opened by a millimetre off by {1e3 * opened:.3f} mm"
    print(f"{'':20} by its robot file: {distances}", flush=True)
