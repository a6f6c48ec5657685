"""Links of many postures of a hand at once, in plain arrays: frames, points on links, and how these move.

The palm's pose is a rotation R and a position t; joints are the robot's free joints, with mimic joints following them.
Links that fixed joints hold together are one group. A twist of the hand is a shift of the palm, a rotation of the whole
hand about a pivot, and joint rates: 6 + m numbers, of which ``rows`` gives the derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.spatial import cross, cross_matrix
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.robot import Robot


@dataclass(frozen=True)
class HandState:
    """Postures of a hand, b at a time.

    Parameters
    ----------
    rotation : (b, 3, 3) array
        Of the palm, body frame.
    position : (b, 3) array
        Of the palm's origin, metres, body frame.
    joints : (b, m) array
        Radians or metres.
    """

    rotation: FloatArray
    position: FloatArray
    joints: FloatArray

    def __len__(self) -> int:
        return len(self.joints)

    def of(self, chosen: IntArray | BoolArray | slice) -> HandState:
        """Return some of the postures."""
        return HandState(self.rotation[chosen], self.position[chosen], self.joints[chosen])

    @classmethod
    def of_values(cls, values: Mapping[str, FloatArray]) -> HandState:
        """Return the one posture of values of the hand's variables."""
        rotation = Rotation.from_quat(values["palm_quaternion"], scalar_first=True).as_matrix()
        position, joints = (np.asarray(values[name], dtype=float) for name in ("palm_position", "joints"))
        return cls(rotation[None], position[None], joints[None])

    @property
    def values(self) -> Values:
        """Values of the hand's variables, (b, m) each, without fingertips' slides."""
        quaternions = Rotation.from_matrix(self.rotation).as_quat(scalar_first=True)
        return {"palm_position": self.position, "palm_quaternion": quaternions, "joints": self.joints}

    @classmethod
    def joined(cls, states: list[HandState]) -> HandState:
        """Return the postures of several sets as one."""
        return cls(*(np.concatenate([getattr(s, name) for s in states]) for name in ("rotation", "position", "joints")))

    def moved(self, twist: FloatArray, pivot: FloatArray, limits: FloatArray) -> HandState:
        """Return the postures after twists (b, 6 + m) about pivots (b, 3), within joint limits (2, m)."""
        turn = Rotation.from_rotvec(twist[:, 3:6]).as_matrix()
        position = pivot + turned(turn, self.position - pivot) + twist[:, :3]
        return HandState(turn @ self.rotation, position, np.clip(self.joints + twist[:, 6:], *limits))


class MovingLinks:
    """Frames of a robot's groups of links in many postures.

    Parameters
    ----------
    robot : Robot
        Its closed linkages are left open.
    """

    def __init__(self, robot: Robot) -> None:
        moving = [joint for joint in robot.joints if joint.moves]
        free = {joint.name: i for i, joint in enumerate(robot.free_joints)}
        group, pose = {robot.root: 0}, {robot.root: np.eye(4)}
        self.parent, self.frame = np.zeros(len(moving), int), np.zeros((len(moving), 4, 4))
        for joint in robot.joints:  # parents before children
            frame = pose[joint.parent] @ joint.frame
            if joint.moves:
                i = moving.index(joint)
                group[joint.child], pose[joint.child] = i + 1, np.eye(4)
                self.parent[i], self.frame[i] = group[joint.parent], frame
            else:
                group[joint.child], pose[joint.child] = group[joint.parent], frame
        self.group, self.pose = group, pose  # of each link: its group, and its pose there
        self.axes = np.array([joint.axis for joint in moving])
        self.slides = np.array([not joint.is_revolute for joint in moving])
        self._motions = np.zeros((2, len(moving), 3, 4))
        for i, axis in enumerate(self.axes):
            turning, cross = self.frame[i, :3, :3], np.cross(axis, np.eye(3)).T  # cross @ v is axis x v
            if self.slides[i]:
                self._motions[0, i, :, 3] = turning @ axis
            else:
                self._motions[:, i, :, :3] = turning @ cross, turning @ cross @ cross
        self.coupling, self.offset = np.zeros((len(moving), len(free))), np.zeros(len(moving))
        for i, joint in enumerate(moving):
            driver, self.coupling[i, free[driver]], self.offset[i] = robot.driving_joint(joint)
        self.moves = np.zeros((len(moving) + 1, len(moving)), bool)  # whether joint j moves group i
        for i, parent in enumerate(self.parent):
            self.moves[i + 1] = self.moves[parent]
            self.moves[i + 1, i] = True

    @property
    def size(self) -> int:
        """Number of components of a twist."""
        return 6 + self.coupling.shape[1]

    def frames(self, state: HandState) -> Frames:
        """Return the frames of all groups in the postures."""
        positions = (state.joints @ self.coupling.T + self.offset)[..., None, None]
        # frame times motion is A + B sin q + C (1 - cos q) of a turning joint, A + B q of a sliding one
        first = np.where(self.slides[:, None, None], positions, np.sin(positions))
        local = self.frame[:, :3] + first * self._motions[0] + (1.0 - np.cos(positions)) * self._motions[1]
        R = np.empty((len(state), len(self.parent) + 1, 3, 3))
        t = np.empty((len(state), len(self.parent) + 1, 3))
        R[:, 0], t[:, 0] = state.rotation, state.position
        for i, parent in enumerate(self.parent):
            moved = R[:, parent] @ local[:, i]
            R[:, i + 1], t[:, i + 1] = moved[..., :3], t[:, parent] + moved[..., 3]
        return Frames(self, R, t)

    def palm_frames(self, joints: FloatArray) -> Frames:
        """Return the frames of all groups at positions (b, m) of the free joints, with the palm at the origin."""
        palms = np.broadcast_to(np.eye(3), (len(joints), 3, 3))
        return self.frames(HandState(palms, np.zeros((len(joints), 3)), np.asarray(joints, dtype=float)))

    def in_groups(self, links: Sequence[str], points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return points (n, 3) given in the frames of their links in those of the links' groups, and these, (n,)."""
        poses = np.array([self.pose[link] for link in links]).reshape(-1, 4, 4)
        at = (poses[:, :3, :3] @ points[:, :, None])[..., 0] + poses[:, :3, 3]
        return at, np.array([self.group[link] for link in links], int)


@dataclass(frozen=True)
class Frames:
    """Frames of the groups of links in b postures.

    Parameters
    ----------
    links : MovingLinks
    R : (b, groups, 3, 3) array
    t : (b, groups, 3) array
        Metres, body frame.
    """

    links: MovingLinks
    R: FloatArray
    t: FloatArray

    def of(self, chosen: IntArray) -> Frames:
        """Return the frames of some of the postures."""
        return Frames(self.links, self.R[chosen], self.t[chosen])

    def of_links(self, links: Sequence[str]) -> FloatArray:
        """Return the frames of links, (b, n, 4, 4), body frame."""
        groups = [self.links.group[link] for link in links]
        local = np.array([self.links.pose[link] for link in links]).reshape(-1, 4, 4)
        result = np.zeros((len(self.R), len(groups), 4, 4))
        result[..., :3, :] = self.R[:, groups] @ local[:, :3]
        result[..., :3, 3] += self.t[:, groups]
        result[..., 3, 3] = 1.0
        return result

    @cached_property
    def _axes(self) -> FloatArray:
        """Directions of the joints' axes, (b, joints, 3), body frame."""
        return np.asarray((self.R[:, 1:] @ self.links.axes[:, :, None])[..., 0])

    @cached_property
    def _moments(self) -> FloatArray:
        """Axes times their origins, (b, joints, 3)."""
        return cross(self._axes, self.t[:, 1:])

    def points(self, at: FloatArray, groups: IntArray) -> FloatArray:
        """Return the positions (b, n, 3), metres, of points (n, 3) given in their groups' frames."""
        return np.asarray((self.R[:, groups] @ at[:, :, None])[..., 0] + self.t[:, groups])

    def directions(self, at: FloatArray, groups: IntArray) -> FloatArray:
        """Return directions (b, n, 3), given in their groups' frames, (n, 3), in the body's."""
        return np.asarray((self.R[:, groups] @ at[:, :, None])[..., 0])

    def cloud(self, cloud: LinkPoints) -> FloatArray:
        """Return the positions (b, n, 3), metres, of points sorted by group, in single precision."""
        result: FloatArray = np.empty((len(self.R), 3, len(cloud.at)), "float32")  # quick along the points
        R, t = self.R.astype(np.float32), self.t.astype(np.float32)
        for group, part in cloud.parts:
            np.matmul(R[:, group], cloud.columns[:, part], out=result[:, :, part])
            result[:, :, part] += t[:, group, :, None]
        return result.transpose(0, 2, 1)

    def rows(self, x: FloatArray, groups: IntArray, n: FloatArray, pivot: FloatArray, which: IntArray) -> FloatArray:
        """Return the derivatives (k, 6 + m) of ``n . x`` by the twist, for points fixed to groups of postures.

        Parameters
        ----------
        x, n : (k, 3) arrays
            Points, metres, and fixed directions, body frame.
        groups, which : (k,) int arrays
            The points' groups and postures.
        pivot : (b, 3) array
        """
        moment = cross(x, n)
        along = (self._axes[which] @ n[:, :, None])[..., 0]
        turning = (self._axes[which] @ moment[:, :, None])[..., 0] - (self._moments[which] @ n[:, :, None])[..., 0]
        rates = np.where(self.links.slides, along, turning) * self.links.moves[groups]
        return np.concatenate([n, moment - cross(pivot[which], n), rates @ self.links.coupling], axis=1)

    def motions(self, x: FloatArray, groups: IntArray, pivot: FloatArray) -> FloatArray:
        """Return the derivatives (b, k, 3, 6 + m) by the twist of points (b, k, 3) fixed to groups (k,)."""
        turning = cross(self._axes[:, None], x[:, :, None] - self.t[:, None, 1:])
        rates = np.where(self.links.slides[:, None], self._axes[:, None], turning)
        result = np.empty((*x.shape, self.links.size))
        result[..., :3], result[..., 3:6] = np.eye(3), -cross_matrix(x - pivot[:, None])
        moving = self.links.moves[groups][:, :, None] * self.links.coupling  # (k, joints, m)
        np.matmul(rates.transpose(0, 1, 3, 2), moving, out=result[..., 6:])
        return result

    def turning_rows(self, v: FloatArray, groups: IntArray, which: IntArray) -> FloatArray:
        """Return the derivatives (k, 6 + m) of ``v . angle`` of groups by the twist, for vectors v (k, 3)."""
        turning = (self._axes[which] @ v[:, :, None])[..., 0]
        rates = np.where(self.links.slides, 0.0, turning) * self.links.moves[groups]
        return np.concatenate([np.zeros_like(v), v, rates @ self.links.coupling], axis=1)


class LinkPoints:
    """Points fixed to groups of links, sorted by group.

    Parameters
    ----------
    at : (n, 3) array
        Metres, frame of the point's group.
    groups : (n,) int array
        In ascending order.
    """

    def __init__(self, at: FloatArray, groups: IntArray) -> None:
        self.at, self.groups = at, groups
        self.columns = np.ascontiguousarray(at.T, dtype=np.float32)
        starts = np.flatnonzero(np.diff(groups, prepend=-1))
        ends = [*starts.tolist(), len(at)][1:]
        self.parts = [(int(groups[i]), slice(int(i), j)) for i, j in zip(starts, ends, strict=True)]


def turned(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors (b, 3) turned by rotations (b, 3, 3)."""
    return np.asarray((rotations @ vectors[..., None])[..., 0])
