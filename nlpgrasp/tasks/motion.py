"""Rigid motions of a body, and the wrenches that produce them under gravity (Newton-Euler equations)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from nlpgrasp.common.meshes.mass_properties import volume_integrals
from nlpgrasp.common.meshes.mesh_file import repaired_mesh
from nlpgrasp.common.meshes.outer_surface import HOLLOW
from nlpgrasp.common.meshes.topology import merge_mesh_vertices
from nlpgrasp.common.spatial import Pose, pose_matrix, rotation_matrices
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray, array, number, prefix_errors, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.task_polytope import TaskPolytope

if TYPE_CHECKING:
    import trimesh


FEWEST_POSES = 4  # of a motion
UPRIGHT = 1e-6  # least cos(theta_2) at which Euler angles are coordinates
GRAVITY = (0.0, 0.0, -9.81)  # m / s^2, world frame
SAMPLES_PER_STEP = 4  # wrench samples per time step


class RigidMotion:
    """A C^2 trajectory through poses, ``g(t)`` of Section 2.1, with its twists.

    Twists are ``(v, w)``, in the order that pairs with wrenches ``(f, m)``, so that the power of (2.1-4b) is
    ``twist @ wrench``; the paper writes ``(w, v)``. Where body frame and inertial frame coincide, as at the paper's m,
    ``twists``, ``body_twists`` and ``spatial_twists`` are the same.

    Parameters
    ----------
    times : (m,) array
        Seconds, increasing; at least 4.
    positions : (m, 3) array
        Of the body frame's origin, inertial frame, metres.
    quaternions : (m, 4) or (m, 3, 3) array
        (w, x, y, z), body to inertial frame, of unit norm within 1e-3; or rotation matrices.

    Raises
    ------
    InputError
        On times that do not increase (the first such row is named), too few poses, or invalid quaternions.
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike, quaternions: ArrayLike) -> None:
        t = array("times", times, (None,))
        if len(t) < FEWEST_POSES:
            raise InputError("times", f"{len(t)} poses", f"at least {FEWEST_POSES}")
        unordered = np.flatnonzero(np.diff(t) <= 0.0)
        if len(unordered):
            i = int(unordered[0])
            raise InputError("times", f"{t[i + 1]:g} s after {t[i]:g} s at row {i + 1}", "increasing times")
        p, rotations = array("positions", positions, (len(t), 3)), rotation_matrices("quaternions", quaternions)
        if len(rotations) != len(t):
            raise InputError("quaternions", f"{len(rotations)} rows", f"{len(t)}, one a time")
        self.times = read_only(t)
        self._position_spline = CubicSpline(t, p)
        self._rotation_spline = RotationSpline(t, Rotation.from_matrix(rotations))

    @classmethod
    def of_poses(cls, times: ArrayLike, poses: ArrayLike | Sequence[Pose]) -> RigidMotion:
        """Return the motion through poses ``[[A, b], [0, 1]]``, (m, 4, 4), that map body points x to ``A x + b``.

        Poses may also be mappings with ``position`` and ``quaternion_wxyz`` or ``quaternion_xyzw``.

        Raises
        ------
        InputError
            As for the class, and when a pose is not a rigid transform (the first such row is named).
        """
        if not isinstance(poses, list | tuple | np.ndarray):
            raise InputError("poses", poses, "a sequence of poses")
        parts = [pose_matrix(f"poses[{i}]", pose) for i, pose in enumerate(poses)]
        if len(parts) < FEWEST_POSES:
            raise InputError("poses", f"{len(parts)} poses", f"at least {FEWEST_POSES}")
        matrices = np.array(parts)
        return cls(times, matrices[:, :3, 3], matrices[:, :3, :3])

    def poses(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the poses ``[[A, b], [0, 1]]``, (j, 4, 4), at times (j,), by default at ``times``.

        Raises
        ------
        InputError
            On times outside the motion, here and in the following methods.
        """
        t = self._times(at)
        result = np.tile(np.eye(4), (len(t), 1, 1))
        result[:, :3, :3], result[:, :3, 3] = self._rotation_spline(t).as_matrix(), self._position_spline(t)
        return result

    def twists(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the twists ``(v, w)`` of (2.1-2), (j, 6), of the body origin in inertial axes, m/s and rad/s."""
        t = self._times(at)
        return np.concatenate(
            [self._position_spline(t, 1), self._rotation_spline(t).apply(self._rotation_spline(t, 1))], axis=1
        )

    def body_twists(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the body twists ``(v, w)``, (j, 6), of the body origin in body axes, m/s and rad/s."""
        t = self._times(at)
        return np.concatenate(
            [self._rotation_spline(t).apply(self._position_spline(t, 1), inverse=True), self._rotation_spline(t, 1)],
            axis=1,
        )

    def spatial_twists(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the spatial twists ``(v, w)``, (j, 6), in inertial axes, v at the inertial origin."""
        t = self._times(at)
        twists = self.twists(t)
        twists[:, :3] += np.cross(self._position_spline(t), twists[:, 3:])
        return twists

    def euler_angles(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the Euler angles ``(theta_1, theta_2, theta_3)`` of (2.1-1), (j, 3), radians.

        Rotations about the body's z, then its y, then its x; theta_2 is within 90 degrees, the others within 180. The
        coordinates are not global (Remark 1).
        """
        R = self._rotation_spline(self._times(at)).as_matrix()
        pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
        return np.stack([np.arctan2(R[:, 1, 0], R[:, 0, 0]), pitch, np.arctan2(R[:, 2, 1], R[:, 2, 2])], axis=1)

    def euler_rates(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the time derivatives of the Euler angles, (j, 3), rad/s, from the equations after (2.1-2).

        Raises
        ------
        InputError
            Also where theta_2 is 90 degrees, a singularity of the angles.
        """
        t = self._times(at)
        angles, w = self.euler_angles(t), self.body_twists(t)[:, 3:]
        cosines = np.cos(angles[:, 1])
        if np.any(cosines < UPRIGHT):
            time = t[int(np.argmin(cosines))]
            raise InputError("at", f"{time:g} s, with theta_2 at 90 degrees", "times at which Euler angles exist")
        s, c = np.sin(angles[:, 2]), np.cos(angles[:, 2])
        yaw_rate = (w[:, 1] * s + w[:, 2] * c) / cosines
        return np.stack([yaw_rate, w[:, 1] * c - w[:, 2] * s, w[:, 0] + yaw_rate * np.sin(angles[:, 1])], axis=1)

    def accelerations(self, at: ArrayLike | None = None) -> FloatArray:
        """Return the body origin's acceleration in inertial axes and the angular acceleration in body axes, (j, 6)."""
        t = self._times(at)
        return np.concatenate([self._position_spline(t, 2), self._rotation_spline(t, 2)], axis=1)

    def _times(self, at: ArrayLike | None) -> FloatArray:
        """Return validated times within the motion."""
        if at is None:
            return self.times
        t, first, last = array("at", at, (None,)), self.times[0], self.times[-1]
        is_outside = (t < first) | (t > last)
        if np.any(is_outside):
            raise InputError("at", f"{t[is_outside][0]:g} s", f"times from {first:g} s to {last:g} s")
        return t


def angular_velocity(angles: ArrayLike, rates: ArrayLike) -> FloatArray:
    """Return the angular velocity in body axes from Euler angles and their rates, after (2.1-2).

    Parameters
    ----------
    angles : (m, 3) array
        ``(theta_1, theta_2, theta_3)``: rotations about z, then y, then x of the body, radians.
    rates : (m, 3) array
        Their time derivatives, rad/s.

    Returns
    -------
    (m, 3) array
        rad/s; also in inertial axes where all angles are zero, as at the paper's m.
    """
    a, b, c = array("angles", angles, (None, 3)).T
    da, db, dc = array("rates", rates, (len(a), 3)).T
    return np.stack(
        [
            dc - da * np.sin(b),
            db * np.cos(c) + da * np.cos(b) * np.sin(c),
            da * np.cos(b) * np.cos(c) - db * np.sin(c),
        ],
        axis=1,
    )


@dataclass(frozen=True)
class MassProperties:
    """Mass, centre of mass and inertia of the grasped body, body frame.

    Parameters
    ----------
    mass : float
        Kilograms.
    center_of_mass : (3,) array
        Metres.
    inertia : (3, 3) array
        About the centre of mass, kg m^2.
    """

    mass: float
    center_of_mass: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", number("MassProperties.mass", self.mass, above=0.0))
        center = array("MassProperties.center_of_mass", self.center_of_mass, (3,))
        object.__setattr__(self, "center_of_mass", read_only(center))
        value = np.zeros((3, 3)) if self.inertia is None else self.inertia
        inertia = array("MassProperties.inertia", value, (3, 3))
        moments = np.linalg.eigvalsh(0.5 * (inertia + inertia.T))
        skew = float(np.max(np.abs(inertia - inertia.T)))
        if skew > 1e-9 * max(float(np.max(np.abs(inertia))), 1e-300) or moments[0] < -1e-12 * abs(moments[-1]):
            raise InputError("MassProperties.inertia", inertia.tolist(), "a symmetric matrix without negative moments")
        if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
            raise InputError(
                "MassProperties.inertia", f"moments {moments.tolist()}", "moments of which none exceeds the other two"
            )
        object.__setattr__(self, "inertia", read_only(inertia))

    @classmethod
    def of_mesh(cls, mesh: trimesh.Trimesh, density: float) -> MassProperties:
        """Return the mass properties of a mesh of uniform density, kg / m^3.

        Every mesh that ``ng.Mesh`` takes is taken, and measured after the same repairs. Closed hollows of a mesh that
        needs no repair have no mass; ``body.mesh`` has none any more, as it counts them as filled.

        Warns
        -----
        UserWarning
            On closed hollows of a mesh that needs repair: they count as filled.
        """
        density, (repaired, notes) = number("density", density, above=0.0), repaired_mesh(mesh)
        if any(note.startswith(HOLLOW) for note in notes):
            merged = merge_mesh_vertices(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
            if len(notes) == 1 and merged.is_volume:
                repaired = merged
            else:
                warn(f"MassProperties.of_mesh: {'; '.join(notes)}")
        integrals = volume_integrals(repaired)
        return cls(density * integrals.volume, integrals.centre, density * integrals.inertia)

    def wrenches(
        self, rotation: FloatArray, acceleration: FloatArray, spin: FloatArray, change: FloatArray
    ) -> FloatArray:
        """Return the wrenches (m, 6) that produce a motion, body frame, about its origin.

        Parameters
        ----------
        rotation : (m, 3, 3) array
            Body to world.
        acceleration : (m, 3) array
            Of the centre of mass less gravity, world frame.
        spin, change : (m, 3) array
            Angular velocity and acceleration, body frame.
        """
        force = self.mass * np.einsum("mji,mj->mi", rotation, acceleration)
        inertia, center = np.asarray(self.inertia), np.asarray(self.center_of_mass)
        moment = change @ inertia + np.cross(spin, spin @ inertia) + np.cross(center, force)
        return np.concatenate([force, moment], axis=1)


@prefix_errors("motion_wrenches: ")
def motion_wrenches(
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    mass: MassProperties,
    gravity: ArrayLike = GRAVITY,
) -> FloatArray:
    """Return the wrenches that the fingers must exert along a trajectory, body frame, about its origin.

    A C^2 spline through the poses is differentiated: ``f = m (a - g)`` and ``m = I w' + w x I w`` about the centre of
    mass.

    Parameters
    ----------
    times : (m,) array
        Seconds, increasing; at least 4.
    positions : (m, 3) array
        Of the body frame's origin, world frame, metres.
    quaternions : (m, 4) or (m, 3, 3) array
        (w, x, y, z), body to world; or rotation matrices.
    mass : MassProperties
        The body's mass, centre of mass and inertia.
    gravity : (3,) array
        World frame, m / s^2.

    Returns
    -------
    (4 m - 3, 6) array
        At the given times and between them.

    Raises
    ------
    InputError
        On times that do not increase (the first such row is named), too few poses, or invalid quaternions.
    """
    motion = RigidMotion(times, positions, quaternions)
    if not isinstance(mass, MassProperties):
        raise InputError("mass", mass, "MassProperties")
    g = array("gravity", gravity, (3,))
    t = motion.times
    samples = np.interp(np.arange(SAMPLES_PER_STEP * (len(t) - 1) + 1) / SAMPLES_PER_STEP, np.arange(len(t)), t)
    rotation, spin, accelerations = (
        motion.poses(samples)[:, :3, :3],
        motion.body_twists(samples)[:, 3:],
        motion.accelerations(samples),
    )
    arm = np.asarray(mass.center_of_mass)
    relative = np.cross(accelerations[:, 3:], arm) + np.cross(spin, np.cross(spin, arm))
    acceleration = accelerations[:, :3] + np.einsum("mij,mj->mi", rotation, relative)
    return mass.wrenches(rotation, acceleration - g, spin, accelerations[:, 3:])


def motion_task(
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    mass: MassProperties,
    gravity: ArrayLike = GRAVITY,
) -> TaskPolytope:
    """Return the convex hull of ``motion_wrenches`` as a task about the body frame's origin."""
    return TaskPolytope(motion_wrenches(times, positions, quaternions, mass, gravity)).given_about(np.zeros(3))
