"""MuJoCo model of fingertips that press on a free object under an external wrench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.simulation.fingertip_scene import DAMPING, DynamicScales, force_indices

MAX_SLIP, MAX_TURN = 2e-3, float(np.radians(3.0))  # metres and radians: largest motions of a held object
MOMENT_ROTATION = 0.02  # radians of rotation at which a contact's moment reaches its friction limit


Course = Callable[[float], tuple[FloatArray, FloatArray]]  # time to wrench (d,) and finger forces (n,)


class FingertipModel:
    """MuJoCo model of a grasp by free fingertips.

    Each fingertip is a ball driven by a motor along each direction its contact can push in, and held in place by a
    spring; motors and springs together never exceed the hand's effort. MuJoCo's contacts transmit the forces, with
    its elliptic (exact) friction cones. Moments about the contact points are applied as torques, cut to what the
    contact model allows at the normal force that MuJoCo reports: MuJoCo's torsional friction differs from the box
    model (2.4-1).

    Parameters
    ----------
    scene : str
        MJCF text of ``mjcf``, without stiffness.
    grasp : Grasp
        Of the scene.
    allowed : ForceSet
        Forces of the scene's contacts within one unit of the force budget.
    effort : float
        Units of the budget available to the hand.
    unit : DynamicScales
        Of the scene.
    gravity : float
        Acceleration along -z (-y in the plane), m / s^2.
    """

    def __init__(
        self, scene: str, grasp: Grasp, allowed: ForceSet, effort: float, unit: DynamicScales, gravity: float = 0.0
    ) -> None:
        self.mujoco = import_mujoco("a simulation")
        self.grasp, self.allowed, self.effort, self.unit = grasp, allowed, effort, unit
        self.gravity = -gravity * np.eye(3)[2 if grasp.space == 3 else 1]
        self.mujoco.set_mju_user_warning(lambda _: None)  # no log files in the user's folder
        try:
            self.model = self.mujoco.MjModel.from_xml_string(scene)
        except (ValueError, self.mujoco.FatalError) as error:
            raise InputError("solution", " ".join(str(error).split()), "a grasp that MuJoCo can simulate") from None
        self.model.pair_dim[:] = np.minimum(self.model.pair_dim, 3)
        self.data = self.mujoco.MjData(self.model)
        self.body = self.model.body("object").id
        self.tips = [self.model.body(f"tip_{i}").id for i in range(len(grasp))]
        self.tip_of_geom = {self.model.geom(f"tip_{i}").id: i for i in range(len(grasp))}
        self.points = in_space(grasp.points)
        self.arm = in_space(grasp.torque_origin[None])[0] - self.model.body_ipos[self.body]
        self.forces, self.moments = components(grasp)
        self.moment_indices = [index for m in self.moments for index in m.indices]
        self.turning = np.concatenate([m.directions for m in self.moments] or [np.zeros((0, 3))])
        self.stiffness, self.damping = self._moment_gains()
        self.pull = slice(0, grasp.space)  # force part of a wrench
        self.turn = slice(3, 6) if grasp.space == 3 else slice(5, 6)
        self.normal, self.tangential = np.zeros(len(grasp)), np.zeros(len(grasp))  # contact forces of the last step

    def run(
        self, course: Course, seconds: float, rise: float, count: int, is_lost: Callable[[Snapshot], bool]
    ) -> list[Snapshot]:
        """Return ``count`` evenly spaced snapshots of a run from rest; a lost grasp ends the run.

        Gravity rises from zero over the first ``rise`` seconds, as the course's forces should.
        """
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_forward(self.model, self.data)
        self.normal[:], self.tangential[:] = 0.0, 0.0
        steps = max(count, round(seconds / self.model.opt.timestep))
        rest_positions = np.array(self.data.xpos[self.tips])
        snapshots: list[Snapshot] = []
        for step in range(1, steps + 1):
            time = step * seconds / steps
            self.model.opt.gravity[:] = min(time / rise, 1.0) * self.gravity
            used = self._step(*course(time))
            if step % (steps // count) == 0 or step == steps:
                snapshots.append(self._snapshot(time, used, rest_positions))
                if is_lost(snapshots[-1]):
                    break
        if any(warning.number for warning in self.data.warning):
            raise NlpgraspError("simulation: MuJoCo became unstable; try another --mass")
        return snapshots

    def _step(self, wrench: FloatArray, forces: FloatArray) -> float:
        """Simulate one time step, and return the used fraction of the hand's effort.

        Parameters
        ----------
        wrench : (d,) array
            Wrench that the fingers are to exert: the body carries the load ``-wrench``. Newtons and newton-metres.
        forces : (n,) array
            Finger forces that exert it, contact by contact as in G, newtons and newton-metres.
        """
        command, used = self._commands(forces)
        self.data.ctrl[:] = command[self.forces]
        self.data.xfrc_applied[self.body] = self._load(wrench, command)
        self.mujoco.mj_step(self.model, self.data)
        if self.moments:
            self._contact_forces()
        return used

    def _commands(self, forces: FloatArray) -> tuple[FloatArray, float]:
        """Return finger forces (n,) with spring forces added, within the effort, and the used fraction of the effort.

        Springs hold the fingertips and the body's rotation in place.
        """
        command = forces.copy()
        tip_displacements = self.data.qpos[-len(self.forces) :]  # metres: the last coordinates, one per force component
        command[self.forces] -= self.unit.stiffness * tip_displacements
        if self.moments:
            restoring = self.stiffness * (self.turning @ self._rotation())
            command[self.moment_indices] -= restoring + self.damping * (self.turning @ self._angular_velocity())
        used = float(self.allowed.gauge(command[None])[0]) / self.effort
        if used > 1.0:
            command /= used
        return command, min(used, 1.0)

    def _load(self, wrench: FloatArray, command: FloatArray) -> FloatArray:
        """Return force and torque (6,) at the body's centre of mass: minus the wrench, plus the contacts' moments."""
        load = np.zeros(6)  # newtons, then newton-metres
        load[self.pull] = -wrench[: self.grasp.space]
        load[self.turn] = -wrench[self.grasp.space :]
        arm = self.data.xmat[self.body].reshape(3, 3) @ self.arm  # from the centre of mass to the torque origin
        load[3:] += _cross_product(arm, load[:3])
        for m in self.moments:
            moment = command[list(m.indices)]
            load[3:] += m.limit(moment, self.normal[m.contact], self.tangential[m.contact]) @ m.directions
        return load

    def _contact_forces(self) -> None:
        """Store the normal and tangential force of each fingertip."""
        self.normal[:], self.tangential[:] = 0.0, 0.0
        force = np.zeros(6)
        for c, geoms in enumerate(self.data.contact.geom.tolist()):
            i = self.tip_of_geom.get(geoms[0], self.tip_of_geom.get(geoms[1], -1))
            if i >= 0:
                self.mujoco.mj_contactForce(self.model, self.data, c, force)
                self.normal[i], self.tangential[i] = force[0], (force[1] ** 2 + force[2] ** 2) ** 0.5

    def _snapshot(self, time: float, used: float, rest_positions: FloatArray) -> Snapshot:
        attitude = np.array(self.data.xmat[self.body]).reshape(3, 3)
        position = np.array(self.data.xpos[self.body])
        tips = np.array(self.data.xpos[self.tips]) - rest_positions
        displacements = self.points @ attitude.T + position - self.points - tips
        slip = float(np.max(np.linalg.norm(displacements, axis=1)))
        return Snapshot(time, slip, float(np.linalg.norm(self._rotation())), used, attitude, position, tips)

    def _rotation(self) -> FloatArray:
        """Return the body's rotation vector."""
        result = np.zeros(3)
        if self.grasp.space == 2:
            result[2] = self.data.qpos[2]
        else:
            self.mujoco.mju_quat2Vel(result, self.data.qpos[3:7], 1.0)
        return result

    def _angular_velocity(self) -> FloatArray:
        """Return the body's angular velocity, body frame."""
        return np.array([0.0, 0.0, self.data.qvel[2]]) if self.grasp.space == 2 else self.data.qvel[3:6]

    def _moment_gains(self) -> tuple[FloatArray, FloatArray]:
        """Return stiffness and near-critical damping of the moments, which reach their limit at ``MOMENT_ROTATION``."""
        matrix = np.zeros(9)
        self.mujoco.mju_quat2Mat(matrix, self.model.body_iquat[self.body])
        axes = matrix.reshape(3, 3)
        inertia = axes @ np.diag(self.model.body_inertia[self.body]) @ axes.T
        inertias = np.einsum("ij,jk,ik->i", self.turning, inertia, self.turning)
        limits = np.array([m.share for m in self.moments for _ in m.indices])
        stiffness = self.unit.force * limits / MOMENT_ROTATION
        return stiffness, DAMPING * np.sqrt(stiffness * inertias)


@dataclass(frozen=True)
class Snapshot:
    """State of a simulation at one time.

    Parameters
    ----------
    time : float
        Seconds.
    slip : float
        Largest distance of a contact point on the body from its fingertip, metres.
    turn : float
        Rotation of the body, radians.
    used : float
        Used share of the hand's effort.
    rotation, position : (3, 3) and (3,) array
        The body's pose.
    tips : (k, 3) array
        Displacement of each fingertip.
    """

    time: float
    slip: float
    turn: float
    used: float
    rotation: FloatArray
    position: FloatArray
    tips: FloatArray

    @property
    def lost(self) -> bool:
        """Whether the body's slip or rotation exceeds the limits."""
        return self.beyond(1.0)

    def beyond(self, fraction: float) -> bool:
        """Return whether slip or rotation has reached a fraction of its limit."""
        return self.slip >= fraction * MAX_SLIP or self.turn >= fraction * MAX_TURN


@dataclass(frozen=True)
class ContactMoment:
    """Moment components of a contact that share one limit.

    Parameters
    ----------
    contact : int
    model : ContactModel
    share : float
        Largest magnitude over the normal force, metres.
    indices : tuple of b int
        Indices among all components.
    directions : (b, 3) array
        Axes of the moments, body frame.
    """

    contact: int
    model: ContactModel
    share: float
    indices: tuple[int, ...]
    directions: FloatArray

    def largest(self, normal: float, tangential: float) -> float:
        """Return the largest moment that a contact can transmit at given normal and tangential force (newtons)."""
        return self.share * self.model.left_for_moments(normal, tangential)

    def limit(self, moment: FloatArray, normal: float, tangential: float) -> FloatArray:
        """Return a moment (b,) scaled down to the largest one that the contact can transmit."""
        magnitude, largest = float(np.linalg.norm(moment)), self.largest(normal, tangential)
        return moment if magnitude <= largest else moment * (largest / magnitude)


def components(grasp: Grasp) -> tuple[list[int], list[ContactMoment]]:
    """Return the indices of the force components, and the moments of the contacts that can transmit moments."""
    forces = force_indices(grasp)
    moments: list[ContactMoment] = []
    for i, (model, part) in enumerate(zip(grasp.contacts, component_slices(grasp.contacts, grasp.space), strict=True)):
        axes = model.axes(grasp.space)
        for block, share in model.blocks(model.components(grasp.space)):
            parts = [j for j in range(block.start, block.stop) if axes[j] >= grasp.space]
            if parts:
                directions = np.array([_moment_axis(grasp, i, axes[j]) for j in parts])
                moments.append(ContactMoment(i, model, share, tuple(part.start + j for j in parts), directions))
    return forces, moments


def _moment_axis(grasp: Grasp, i: int, axis: int) -> FloatArray:
    """Return the axis of a moment component, body frame."""
    return np.eye(3)[2] if grasp.space == 2 else np.asarray(grasp.frames[i][:, axis - 3])


def _cross_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product of two vectors, faster than numpy's general function."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
