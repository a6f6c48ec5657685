"""Tangents of contacts that have a direction along the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nlpgrasp.common.shown.numbers import vector
from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError

TELLING = 0.1  # sine of the angle to the normal from which starts use a place
PARALLEL = 1e-6  # sine of the angle to the normal below which a direction says nothing


def direction_field(field: str, value: ArrayLike | None) -> tuple[float, ...] | None:
    """Return a direction as a tuple of unit length, or ``None`` when it is left out."""
    if value is None:
        return None
    direction = array(field, value, (3,))
    size = float(np.linalg.norm(direction))
    if size <= 0.0:
        raise InputError(field, value, "a direction of some length")
    return tuple((direction if abs(size - 1.0) < 1e-12 else direction / size).tolist())


def turned_direction(direction: tuple[float, ...] | None, rotation: FloatArray) -> tuple[float, ...] | None:
    """Return a direction in a turned body frame; as it is where there is none, or in the plane, which needs none."""
    return direction if direction is None or len(rotation) == 2 else tuple((rotation @ direction).tolist())


def off_normal(direction: tuple[float, ...], normals: FloatArray) -> NDArray[np.bool_]:
    """Return at which of the unit normals (b, 3) a direction says well how a line or rectangle lies."""
    return np.asarray(np.linalg.norm(np.cross(normals, direction), axis=1) >= TELLING * np.linalg.norm(direction))


class AlongNormalError(InputError):
    """A contact's direction that is along the normal of the place it came to, where it says nothing."""


def tangents_along(normals: FloatArray, direction: tuple[float, ...] | None, name: str) -> FloatArray:
    """Return right-handed tangents whose first is the direction's part along the surface: (b, 2, 3).

    In the plane there is only one tangent, and no direction is needed.

    Raises
    ------
    InputError
        When there is no direction, or one is along a normal.
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
