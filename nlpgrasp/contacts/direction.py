"""Tangent frames of contacts with a direction, such as lines and rectangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nlpgrasp.common.shown.numbers import vector
from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError

TELLING = 0.1  # least sine of the angle between direction and normal at initial contact points
PARALLEL = 1e-6  # sine of the angle between direction and normal below which the tangent is undefined


def direction_field(field: str, value: ArrayLike | None) -> tuple[float, ...] | None:
    """Return a validated direction as a unit vector (tuple), or ``None``."""
    if value is None:
        return None
    direction = array(field, value, (3,))
    size = float(np.linalg.norm(direction))
    if size <= 0.0:
        raise InputError(field, value, "a direction of some length")
    return tuple((direction if abs(size - 1.0) < 1e-12 else direction / size).tolist())


def turned_direction(direction: tuple[float, ...] | None, rotation: FloatArray) -> tuple[float, ...] | None:
    """Return a direction in a rotated body frame; unchanged if None, or in the plane, which needs none."""
    return direction if direction is None or len(rotation) == 2 else tuple((rotation @ direction).tolist())


def off_normal(direction: tuple[float, ...], normals: FloatArray) -> NDArray[np.bool_]:
    """Return at which unit normals (b, 3) a direction is far enough off the normal to orient a line or rectangle."""
    return np.asarray(np.linalg.norm(np.cross(normals, direction), axis=1) >= TELLING * np.linalg.norm(direction))


class AlongNormalError(InputError):
    """Error: a contact's direction is parallel to the surface normal, so its tangent is undefined."""


def tangents_along(normals: FloatArray, direction: tuple[float, ...] | None, name: str) -> FloatArray:
    """Return right-handed unit tangents (b, 2, 3), the first along the direction's tangential part.

    In the plane there is only one tangent, and no direction is needed.

    Raises
    ------
    InputError
        When the direction is None or parallel to a normal.
    """
    if normals.shape[-1] == 2:
        return any_tangents(normals)
    if direction is None:
        raise InputError(
            f"{name}.direction", None, "the line's or rectangle's direction in the body frame, or tangents"
        )
    first = np.asarray(direction) - (normals @ np.asarray(direction))[:, None] * normals
    size = np.linalg.norm(first, axis=1)
    if np.any(size < PARALLEL):
        raise AlongNormalError(
            f"{name}.direction", direction, f"one off the normal [{vector(normals[np.argmin(size)])}]"
        )
    first = first / size[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1)


def symbolic_tangents(
    normal: Expression, direction: tuple[float, ...] | None, name: str
) -> tuple[Expression, Expression]:
    """Return the two unit tangents at a symbolic normal (3,)."""
    import casadi as ca  # numeric use needs none

    if direction is None:
        raise InputError(f"{name}.direction", None, "the line's or rectangle's direction in the body frame")
    d = ca.DM(list(direction))
    first = d - ca.dot(normal, d) * normal
    first = first / ca.sqrt(ca.sumsqr(first) + PARALLEL**2)
    return first, ca.cross(normal, first)
