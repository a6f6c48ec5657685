"""Wrenches of gravity and inertia along a trajectory (Newton-Euler equations)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.meshes.mass import volume_integrals
from nlpgrasp.common.validation import FloatArray, array, number, read_only, within
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.polytope import TaskPolytope
from nlpgrasp.tasks.rigid_motion import RigidMotion

if TYPE_CHECKING:
    import trimesh

GRAVITY = (0.0, 0.0, -9.81)  # m / s^2, world frame
BETWEEN = 4  # wrench samples per time step


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
        middle = array("MassProperties.center_of_mass", self.center_of_mass, (3,))
        object.__setattr__(self, "center_of_mass", read_only(middle))
        given = np.zeros((3, 3)) if self.inertia is None else self.inertia
        inertia = array("MassProperties.inertia", given, (3, 3))
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
        """Return the mass properties of a closed mesh (``body.mesh``) of uniform density, kg / m^3."""
        import trimesh

        if not isinstance(mesh, trimesh.Trimesh) or not mesh.is_volume:
            raise InputError("mesh", mesh, "a closed trimesh.Trimesh, such as the mesh of an ng.Mesh")
        density, found = number("density", density, above=0.0), volume_integrals(mesh)
        return cls(density * found.volume, found.centre, density * found.inertia)

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
        inertia, middle = np.asarray(self.inertia), np.asarray(self.center_of_mass)
        moment = change @ inertia + np.cross(spin, spin @ inertia) + np.cross(middle, force)
        return np.concatenate([force, moment], axis=1)


@within("motion_wrenches: ")
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
    down = array("gravity", gravity, (3,))
    t = motion.times
    at = np.interp(np.arange(BETWEEN * (len(t) - 1) + 1) / BETWEEN, np.arange(len(t)), t)
    rotation, spin, second = motion.poses(at)[:, :3, :3], motion.body_twists(at)[:, 3:], motion.accelerations(at)
    arm = np.asarray(mass.center_of_mass)
    inward = np.cross(second[:, 3:], arm) + np.cross(spin, np.cross(spin, arm))
    acceleration = second[:, :3] + np.einsum("mij,mj->mi", rotation, inward)
    return mass.wrenches(rotation, acceleration - down, spin, second[:, 3:])


def motion_task(
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    mass: MassProperties,
    gravity: ArrayLike = GRAVITY,
) -> TaskPolytope:
    """Return the convex hull of ``motion_wrenches`` as a task about the body frame's origin."""
    return TaskPolytope(motion_wrenches(times, positions, quaternions, mass, gravity)).given_about(np.zeros(3))
