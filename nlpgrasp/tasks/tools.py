"""Task constructors for common tool uses: press, cut, turn, write, insert, lift, pour.

All have moments about the body frame's origin and can be added: ``press(tip, down, 15) + turn(axis, 0.4)``. A problem
moves them to its own torque origin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array, kilograms, number, prefix_errors
from nlpgrasp.common.validation import angle as radians
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.task_polytope import TaskPolytope

WEIGHT = 9.81  # m / s^2, gravitational acceleration
TILTS = 13  # sampled orientations of a pour
ORIGIN = np.zeros(3)  # of the body frame, metres


@prefix_errors("press: ")
def press(point: ArrayLike, direction: ArrayLike, force: float, sideways: float = 0.2) -> TaskEllipsoid:
    """Return the task of pressing with a tool's point by a force from zero to ``force``.

    Parameters
    ----------
    point : (3,) array
        Of the tool, body frame, metres.
    direction : (3,) array
        Of the pressing force, body frame.
    force : float
        Newtons.
    sideways : float
        Lateral forces over ``force``, as from friction of the pressed surface.
    """
    unit, force = _check_direction("direction", direction), number("force", force, above=0.0)
    lateral = number("sideways", sideways, at_least=0.0) * force
    forces = np.concatenate([0.5 * force * unit[None], lateral * _orthogonal_vectors(unit)])
    return _tool_at_point(point, forces, 0.5 * force * unit)


@prefix_errors("cut: ")
def cut(point: ArrayLike, down: ArrayLike, along: ArrayLike, force: float, sideways: float = 0.1) -> TaskEllipsoid:
    """Return the task of cutting: pressing a blade down and drawing it to and fro, each with up to ``force``.

    Parameters
    ----------
    point : (3,) array
        Of the blade, body frame, metres.
    down, along : (3,) array
        Directions of pressing and of the edge, body frame.
    force : float
        Newtons.
    sideways : float
        Lateral forces over ``force``.
    """
    press_direction, edge = _check_direction("down", down), _check_direction("along", along)
    edge = edge - (edge @ press_direction) * press_direction
    if np.linalg.norm(edge) < 1e-6:
        raise InputError("along", along, "a direction across the one the blade presses in")
    edge /= np.linalg.norm(edge)
    force = number("force", force, above=0.0)
    lateral = number("sideways", sideways, at_least=0.0) * force
    forces = np.array([0.5 * force * press_direction, force * edge, lateral * np.cross(press_direction, edge)])
    return _tool_at_point(point, forces, 0.5 * force * press_direction)


@prefix_errors("turn: ")
def turn(axis: ArrayLike, torque: float, one_way: bool = False) -> TaskEllipsoid:
    """Return the task of turning about an axis with up to ``torque``, in one or both senses.

    Parameters
    ----------
    axis : (3,) array
        Body frame.
    torque : float
        Newton-metres.
    one_way : bool
        Whether only the positive sense about the axis is required.
    """
    unit, torque = _check_direction("axis", axis), number("torque", torque, above=0.0)
    if not isinstance(one_way, bool):
        raise InputError("one_way", one_way, "True or False")
    scale = 0.5 if one_way else 1.0  # one way from 0 to the torque: half of it is both centre and semi-axis
    moment = np.concatenate([np.zeros(3), scale * torque * unit])
    return _tool_ellipsoid(moment[None], moment if one_way else np.zeros(6))


@prefix_errors("write: ")
def write(lead: ArrayLike, axis: ArrayLike, force: float, torque: float) -> TaskEllipsoid:
    """Return the task of writing with a pencil: forces and torques at its lead (Example 3-5, (3.3-2)).

    Parameters
    ----------
    lead : (3,) array
        Body frame, metres.
    axis : (3,) array
        Of the pencil, body frame, in the direction of pressing.
    force : float
        Largest force along the pencil, newtons; across it, a third.
    torque : float
        Largest torque about axes across the pencil, at the lead, newton-metres; about its own axis, a tenth.
    """
    unit, force = _check_direction("axis", axis), number("force", force, above=0.0)
    torque = number("torque", torque, above=0.0)
    forces = np.concatenate([0.5 * force * unit[None], force / 3.0 * _orthogonal_vectors(unit)])
    moments = np.concatenate([0.1 * torque * unit[None], torque * _orthogonal_vectors(unit)])
    return _tool_at_point(lead, forces, 0.5 * force * unit, moments)


@prefix_errors("insert: ")
def insert(point: ArrayLike, direction: ArrayLike, force: float, jam: float, depth: float) -> TaskEllipsoid:
    """Return the task of inserting a peg with up to ``force``, against jamming forces and moments at its end.

    Parameters
    ----------
    point : (3,) array
        The peg's end, body frame, metres.
    direction : (3,) array
        Of insertion, body frame.
    force : float
        Newtons.
    jam : float
        Lateral forces at the end, newtons.
    depth : float
        Insertion depth, metres: the distance of two opposite jamming forces.
    """
    unit, force = _check_direction("direction", direction), number("force", force, above=0.0)
    jam, depth = number("jam", jam, above=0.0), number("depth", depth, above=0.0)
    forces = np.concatenate([0.5 * force * unit[None], jam * _orthogonal_vectors(unit)])
    return _tool_at_point(point, forces, 0.5 * force * unit, jam * depth * _orthogonal_vectors(unit))


@prefix_errors("lift: ")
def lift(
    center_of_mass: ArrayLike, mass: float, up: ArrayLike = (0.0, 0.0, 1.0), acceleration: float = 2.0
) -> TaskEllipsoid:
    """Return the task of carrying a body upright and accelerating it in any direction.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    up : (3,) array
        In the body frame.
    acceleration : float
        Largest acceleration in any direction, m / s^2.
    """
    upward, mass = _check_direction("up", up), kilograms(mass)
    acceleration_limit = number("acceleration", acceleration, above=0.0)
    return _tool_at_point(
        center_of_mass, mass * acceleration_limit * np.eye(3), mass * WEIGHT * upward, name="center_of_mass"
    )


@prefix_errors("gravity: ")
def gravity(center_of_mass: ArrayLike, mass: float) -> TaskEllipsoid:
    """Return the task of carrying a body's weight in any orientation.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    """
    return _tool_at_point(center_of_mass, kilograms(mass) * WEIGHT * np.eye(3), np.zeros(3), name="center_of_mass")


@prefix_errors("pour: ")
def pour(
    center_of_mass: ArrayLike, mass: float, axis: ArrayLike, angle: float, up: ArrayLike = (0.0, 0.0, 1.0)
) -> TaskPolytope:
    """Return the task of carrying a body in all orientations from upright to tilted about an axis.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    axis : (3,) array
        Of the tilt, body frame.
    angle : float
        Radians, at most pi.
    up : (3,) array
        Upward direction in the body frame while the body is upright.
    """
    upward, tilt_axis = _check_direction("up", up), _check_direction("axis", axis)
    angle = radians("angle", angle, np.pi, "pi")
    weight, point = kilograms(mass) * WEIGHT, array("center_of_mass", center_of_mass, (3,))
    t = np.linspace(0.0, angle, TILTS)[:, None]
    # the body turns by t, so that in its frame up turns by -t (Rodrigues)
    rotated = (
        np.cos(t) * upward
        - np.sin(t) * np.cross(tilt_axis, upward)
        + (1.0 - np.cos(t)) * (tilt_axis @ upward) * tilt_axis
    )
    # corners where tangents of neighbours on the circle meet, so that the polytope contains the arc
    axial = (tilt_axis @ upward) * tilt_axis
    middle = rotated[1:] + rotated[:-1] - 2.0 * axial
    radius = float(np.linalg.norm(upward - axial))
    corners = axial + 2.0 * radius**2 * middle / np.maximum(np.sum(middle**2, axis=1), 1e-300)[:, None]
    forces = weight * np.concatenate([rotated[:1], corners, rotated[-1:]])
    return TaskPolytope(np.concatenate([forces, np.cross(point, forces)], axis=1)).given_about(ORIGIN)


@prefix_errors("disturbance: ")
def disturbance(force: float, torque: float, point: ArrayLike | None = None) -> TaskEllipsoid:
    """Return the task of exerting any force at a point and any torque, up to given sizes.

    Parameters
    ----------
    force, torque : float
        Newtons and newton-metres; at least zero, not both zero.
    point : (3,) array, optional
        Body frame, metres, often ``body.centroid``; by default the frame's origin, with a warning if far from the body.
    """
    force, torque = number("force", force, at_least=0.0), number("torque", torque, at_least=0.0)
    if force == torque == 0.0:
        raise InputError("force", 0.0, "a force or a torque greater than zero")
    task = _tool_at_point(ORIGIN if point is None else point, force * np.eye(3), np.zeros(3), torque * np.eye(3))
    task.point_left_out = point is None and force > 0.0
    return task


def _check_direction(name: str, value: ArrayLike) -> FloatArray:
    """Return a validated direction as a unit vector (3,)."""
    vector = array(name, value, (3,))
    if not (size := float(np.linalg.norm(vector))):
        raise InputError(name, value, "a direction that is not zero")
    return vector / size


def _orthogonal_vectors(direction: FloatArray) -> FloatArray:
    """Return two unit vectors orthogonal to a direction, (2, 3)."""
    return np.linalg.svd(direction[None])[2][1:]


def _tool_at_point(
    point: ArrayLike, forces: FloatArray, center: FloatArray, moments: FloatArray | None = None, name: str = "point"
) -> TaskEllipsoid:
    """Return the task ellipsoid with semi-axes of forces at a point and of pure moments.

    Moments of the task are about the body frame's origin.
    """
    position = array(name, point, (3,))
    moments = np.zeros((0, 3)) if moments is None else moments
    axes = np.block([[forces, np.cross(position, forces)], [np.zeros_like(moments), moments]])
    return _tool_ellipsoid(axes, np.concatenate([center, np.cross(position, center)]))


def _tool_ellipsoid(axes: FloatArray, center: FloatArray) -> TaskEllipsoid:
    """Return the task ellipsoid with given semi-axes, without zero ones, about the body frame's origin."""
    nonzero = axes[np.any(axes != 0.0, axis=1)]
    return TaskEllipsoid.from_axes(nonzero, center).given_about(ORIGIN)
