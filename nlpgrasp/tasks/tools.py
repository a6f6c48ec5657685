"""Tasks of tools, in one line each: what the fingers exert on the body, with the wrench at the tool's point.

All are about the body frame's origin, so that they add up: ``press(tip, down, 15) + turn(axis, 0.4)``. A problem moves
them to its own torque origin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.angles import angle as radians
from nlpgrasp.common.given.masses import kilograms
from nlpgrasp.common.validation import FloatArray, array, number, within
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.polytope import TaskPolytope

WEIGHT = 9.81  # newtons a kilogram
TILTS = 13  # orientations between upright and tilted that a pour passes
ORIGIN = np.zeros(3)


@within("press: ")
def press(point: ArrayLike, direction: ArrayLike, force: float, sideways: float = 0.2) -> TaskEllipsoid:
    """Return: press with a point of the tool, with anything from nothing to ``force``.

    Parameters
    ----------
    point : (3,) array
        Of the tool, body frame, metres.
    direction : (3,) array
        In which the tool presses, body frame.
    force : float
        Newtons.
    sideways : float
        Forces across the direction, over ``force``: what the pressed surface's friction may ask for.
    """
    along, force = _direction("direction", direction), number("force", force, above=0.0)
    across = number("sideways", sideways, at_least=0.0) * force
    forces = np.concatenate([0.5 * force * along[None], across * _across(along)])
    return _at_point(point, forces, 0.5 * force * along)


@within("cut: ")
def cut(point: ArrayLike, down: ArrayLike, along: ArrayLike, force: float, sideways: float = 0.1) -> TaskEllipsoid:
    """Return: a blade pressed down with up to ``force`` and drawn to and fro along its edge with as much.

    Parameters
    ----------
    point : (3,) array
        Of the blade, body frame, metres.
    down, along : (3,) array
        In which it presses, and its edge, body frame.
    force : float
        Newtons.
    sideways : float
        Forces across the blade, over ``force``.
    """
    below, edge = _direction("down", down), _direction("along", along)
    edge = edge - (edge @ below) * below
    if np.linalg.norm(edge) < 1e-6:
        raise InputError("along", along, "a direction across the one the blade presses in")
    edge /= np.linalg.norm(edge)
    force = number("force", force, above=0.0)
    side = number("sideways", sideways, at_least=0.0) * force
    forces = np.array([0.5 * force * below, force * edge, side * np.cross(below, edge)])
    return _at_point(point, forces, 0.5 * force * below)


@within("turn: ")
def turn(axis: ArrayLike, torque: float, one_way: bool = False) -> TaskEllipsoid:
    """Return: turn the body about an axis with up to ``torque``, either way or one way.

    Parameters
    ----------
    axis : (3,) array
        Body frame.
    torque : float
        Newton-metres.
    one_way : bool
        Only in the positive sense about the axis.
    """
    along, torque = _direction("axis", axis), number("torque", torque, above=0.0)
    if not isinstance(one_way, bool):
        raise InputError("one_way", one_way, "True or False")
    share = 0.5 if one_way else 1.0
    moment = np.concatenate([np.zeros(3), share * torque * along])
    return _made(moment[None], moment if one_way else np.zeros(6))


@within("write: ")
def write(lead: ArrayLike, axis: ArrayLike, force: float, torque: float) -> TaskEllipsoid:
    """Return Example 3-5: torque about the two axes across the pencil at its lead, and a force along it, (3.3-2).

    Parameters
    ----------
    lead : (3,) array
        Body frame, metres.
    axis : (3,) array
        Along the pencil, body frame, in the direction in which the lead is pressed.
    force : float
        Largest force along the pencil, newtons; a third of it across.
    torque : float
        Either way about the axes across the pencil, at the lead, newton-metres; a tenth of it about its own.
    """
    along, force = _direction("axis", axis), number("force", force, above=0.0)
    torque = number("torque", torque, above=0.0)
    forces = np.concatenate([0.5 * force * along[None], force / 3.0 * _across(along)])
    moments = np.concatenate([0.1 * torque * along[None], torque * _across(along)])
    return _at_point(lead, forces, 0.5 * force * along, moments)


@within("insert: ")
def insert(point: ArrayLike, direction: ArrayLike, force: float, jam: float, depth: float) -> TaskEllipsoid:
    """Return: push a peg in with up to ``force``, against jams that push and turn its end.

    Parameters
    ----------
    point : (3,) array
        The end that goes into the hole, body frame, metres.
    direction : (3,) array
        In which it is pushed, body frame.
    force : float
        Newtons.
    jam : float
        Forces across the direction at the end, newtons.
    depth : float
        Length of peg in the hole, metres: two opposite forces that far apart turn it.
    """
    along, force = _direction("direction", direction), number("force", force, above=0.0)
    jam, depth = number("jam", jam, above=0.0), number("depth", depth, above=0.0)
    forces = np.concatenate([0.5 * force * along[None], jam * _across(along)])
    return _at_point(point, forces, 0.5 * force * along, jam * depth * _across(along))


@within("lift: ")
def lift(
    center_of_mass: ArrayLike, mass: float, up: ArrayLike = (0.0, 0.0, 1.0), acceleration: float = 2.0
) -> TaskEllipsoid:
    """Return: carry a body's weight upright, and accelerate it in any direction.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    up : (3,) array
        In the body frame.
    acceleration : float
        The largest, in any direction, m / s^2.
    """
    above, mass = _direction("up", up), kilograms(mass)
    shaking = number("acceleration", acceleration, above=0.0)
    return _at_point(center_of_mass, mass * shaking * np.eye(3), mass * WEIGHT * above, name="center_of_mass")


@within("gravity: ")
def gravity(center_of_mass: ArrayLike, mass: float) -> TaskEllipsoid:
    """Return: carry a body in any orientation.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    """
    return _at_point(center_of_mass, kilograms(mass) * WEIGHT * np.eye(3), np.zeros(3), name="center_of_mass")


@within("pour: ")
def pour(
    center_of_mass: ArrayLike, mass: float, axis: ArrayLike, angle: float, up: ArrayLike = (0.0, 0.0, 1.0)
) -> TaskPolytope:
    """Return: carry a body in every orientation from upright to tilted about an axis.

    Parameters
    ----------
    center_of_mass : (3,) array
        Body frame, metres.
    mass : float
        Kilograms.
    axis : (3,) array
        That the body is tilted about, body frame.
    angle : float
        Radians, at most pi.
    up : (3,) array
        In the body's frame while it is upright.
    """
    above, about = _direction("up", up), _direction("axis", axis)
    angle = radians("angle", angle, np.pi, "pi")
    weight, where = kilograms(mass) * WEIGHT, array("center_of_mass", center_of_mass, (3,))
    t = np.linspace(0.0, angle, TILTS)[:, None]
    # the body turns by t, so that in its frame up turns by -t (Rodrigues)
    turned = np.cos(t) * above - np.sin(t) * np.cross(about, above) + (1.0 - np.cos(t)) * (about @ above) * about
    # corners where the tangents of neighbours on the circle meet: the polytope is around the arc, not inside it
    along = (about @ above) * about
    middle = turned[1:] + turned[:-1] - 2.0 * along
    radius = float(np.linalg.norm(above - along))
    corners = along + 2.0 * radius**2 * middle / np.maximum(np.sum(middle**2, axis=1), 1e-300)[:, None]
    forces = weight * np.concatenate([turned[:1], corners, turned[-1:]])
    return TaskPolytope(np.concatenate([forces, np.cross(where, forces)], axis=1)).given_about(ORIGIN)


@within("disturbance: ")
def disturbance(force: float, torque: float, point: ArrayLike | None = None) -> TaskEllipsoid:
    """Return: any force at a point, and any torque, up to these sizes.

    Parameters
    ----------
    force, torque : float
        Newtons and newton-metres; at least zero, not both zero.
    point : (3,) array, optional
        Body frame, metres: often ``body.centroid``. When left out the frame's origin, if far from it with a warning.
    """
    force, torque = number("force", force, at_least=0.0), number("torque", torque, at_least=0.0)
    if force == torque == 0.0:
        raise InputError("force", 0.0, "a force or a torque greater than zero")
    found = _at_point(ORIGIN if point is None else point, force * np.eye(3), np.zeros(3), torque * np.eye(3))
    found.point_left_out = point is None and force > 0.0
    return found


def _direction(name: str, value: ArrayLike) -> FloatArray:
    given = array(name, value, (3,))
    if not (size := float(np.linalg.norm(given))):
        raise InputError(name, value, "a direction that is not zero")
    return given / size


def _across(along: FloatArray) -> FloatArray:
    """Return two unit directions across one, (2, 3)."""
    return np.linalg.svd(along[None])[2][1:]


def _at_point(
    point: ArrayLike, forces: FloatArray, center: FloatArray, moments: FloatArray | None = None, name: str = "point"
) -> TaskEllipsoid:
    """Return the ellipsoid of forces at a point, and moments, as semi-axes, about the body frame's origin."""
    where = array(name, point, (3,))
    moments = np.zeros((0, 3)) if moments is None else moments
    axes = np.block([[forces, np.cross(where, forces)], [np.zeros_like(moments), moments]])
    return _made(axes, np.concatenate([center, np.cross(where, center)]))


def _made(axes: FloatArray, center: FloatArray) -> TaskEllipsoid:
    kept = axes[np.any(axes != 0.0, axis=1)]
    return TaskEllipsoid.from_axes(kept, center).given_about(ORIGIN)
