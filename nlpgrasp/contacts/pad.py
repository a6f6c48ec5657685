"""Base class of line and plane contacts, with a tangent frame along a given direction."""

from __future__ import annotations

from abc import abstractmethod
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.formatting import vector
from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import BoolArray, FloatArray, array, number
from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.contacts.cone_sums import FrictionConeSum
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.errors import InputError

LEAST_SINE = 0.1  # least sine of the angle between direction and normal at initial contact points
PARALLEL = 1e-6  # sine of the angle between direction and normal below which the tangent is undefined
PAD_SHAPES = "the shape of lines and rectangles"  # omitted from global bounds: these take the disc around each
MODELS = ("coulomb", "box")  # friction models, the default first

Friction = tuple[float | None, float | None, str]  # coefficient, torsion, model
Arms = tuple[tuple[float, float], ...]  # positions of ends or corners along both tangents, metres

friction_cone_sum = lru_cache(maxsize=256)(FrictionConeSum)  # equal contacts share their computed maps


class PadContact(RangeContact):
    """A contact over a line or a pad, with any pressure distribution.

    Without friction, and in the plane, the box is equivalent to point contacts at the ends or corners. With friction in
    space, ``model`` is ``"coulomb"``, friction contacts at the ends or corners (docs/paper/02_contacts.md), or the
    ``"box"`` of (2.4-1).
    """

    friction: float | None
    torsional_friction: float | None
    direction: tuple[float, float, float] | None
    model: str | None

    @property
    @abstractmethod
    def arms(self) -> Arms:
        """Positions of the pad's ends or corners along both tangents, relative to the contact point, metres."""

    @property
    @abstractmethod
    def sides(self) -> tuple[float, float]:
        """Sides of the rectangle that has to be on a face for the contact to exist, metres, the first along it."""

    @abstractmethod
    def box_split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment from the NLP variables of the box model (symbolic, body frame)."""

    @abstractmethod
    def box_membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return expressions, all nonnegative if and only if the NLP variables of the box model are admissible."""

    @abstractmethod
    def box_variables(self, space: int) -> int:
        """Return the number of NLP variables of the box model."""

    @property
    def label(self) -> str:
        """Name of the model in tables, with "(box)" for the box model."""
        return f"{self.kind} (box)" if self.friction is not None and self.model == "box" else self.kind

    @property
    def coefficients(self) -> dict[str, float]:
        """Friction coefficients by name: ``friction`` and, for the box model, ``torsional_friction`` (metres)."""
        values = {"friction": self.friction, "torsional_friction": self.torsional_friction}
        return {name: value for name, value in values.items() if value is not None}

    def points(self, components: int) -> FrictionConeSum | None:
        """Return the sum of the friction cones at the ends or corners; None if the force domain is a box."""
        if self.friction is None or self.model == "box" or components < 5:  # fewer: in the plane
            return None
        return friction_cone_sum(self.arms, self.friction, self.axes(3))

    def has_domain_of(self, other: ContactModel, space: int) -> bool:
        """Return whether the force domain equals that of another contact, whose direction may differ."""
        points = self.points(self.components(space))
        if points is None or not isinstance(other, PadContact):
            return self == other
        return points == other.points(other.components(space))

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto the force domain."""
        points = self.points(z.shape[-1])
        return super().project(z) if points is None else points.project(z)

    def project_lifted(self, z: FloatArray) -> FloatArray:
        """Return the forces (..., m) at ends or corners that add up to the projection; itself for the box model."""
        points = self.points(z.shape[-1])
        return super().project_lifted(z) if points is None else points.project_lifted(z)

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, (n_i (n_i + 1) / 2, ...)."""
        points = self.points(z.shape[-1])
        return super().derivative_entries(z) if points is None else points.derivative_entries(z)

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support along ``z`` (..., n_i) for normal force at most 1, and a maximiser (..., n_i)."""
        points = self.points(z.shape[-1])
        return super().extreme(z) if points is None else points.extreme(z)

    def generators(self, space: int) -> FloatArray:
        """Return the matrix A, (n_i, m), from forces at ends or corners to components; identity for the box model."""
        points = self.points(self.components(space))
        return super().generators(space) if points is None else points.generators

    def cones(self, space: int) -> list[FloatArray]:
        """Return (r, m) matrices of second-order cones: those of friction at ends or corners, or of the box model."""
        points = self.points(self.components(space))
        return super().cones(space) if points is None else points.cones()

    def variables(self, space: int) -> int:
        """Return the number of NLP variables: a body-frame force per end or corner, or those of the box model."""
        return self.box_variables(space) if self.points(self.components(space)) is None else 3 * len(self.arms)

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variables of a unit force along the normal ``(space,)`` and no moment."""
        space = len(normal)
        if self.points(self.components(space)) is not None:
            return np.tile(normal / len(self.arms), len(self.arms))
        size = self.variables(space)
        force = normal if self.friction is not None else np.ones(1)  # where there is friction; or its size alone
        return np.concatenate([force, np.zeros(size)])[:size]

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment about the contact point from NLP variables (symbolic, body frame)."""
        import casadi as ca  # numeric use needs none

        if self._is_box(normal):
            return self.box_split(x, normal)
        first, second = self.symbolic_tangents(normal)
        force, moment = ca.DM.zeros(3), ca.DM.zeros(3)
        for i, (a, b) in enumerate(self.arms):
            u = x[3 * i : 3 * i + 3]
            force, moment = force + u, moment + ca.cross(a * first + b * second, u)
        return force, moment

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return expressions that are all nonnegative if and only if the NLP variables are admissible (symbolic)."""
        if self._is_box(normal):
            return self.box_membership(x, normal)
        rows = []
        for i in range(len(self.arms)):
            u = x[3 * i : 3 * i + 3]
            pressing = normal.T @ u
            cone = (1.0 + (self.friction or 0.0) ** 2) * pressing**2 - u.T @ u
            rows += [(f"friction at point {i}", cone), (f"unilateral at point {i}", pressing)]
        return rows

    def squared_size(self, x: Expression, normal: Expression) -> Expression:
        """Return the squared norm of force and moment, given NLP variables ``x`` (symbolic)."""
        if self._is_box(normal):
            return super().squared_size(x, normal)
        force, moment = self.split(x, normal)
        return force.T @ force + moment.T @ moment

    def symbolic_tangents(self, normal: Expression) -> tuple[Expression, Expression]:
        """Return the two unit tangents at a symbolic normal (3,), as ``tangents`` does."""
        return symbolic_tangents(normal, self.direction, type(self).__name__)

    def _is_box(self, normal: Expression) -> bool:
        return self.points(self.components(int(normal.shape[0]))) is None


def friction_fields(
    name: str, friction: float | None, torsion: float | None, model: object, mean_arm: float
) -> Friction:
    """Return validated friction, torsional friction and model of a pad.

    The box's torsion defaults to uniform pressure, ``mu mean_arm``. Contacts without friction have the default model.
    """
    if not isinstance(model, str) or model not in MODELS:
        raise InputError(f"{name}.model", model, " or ".join(repr(m) for m in MODELS))
    if friction is None:
        if torsion is not None:
            raise InputError(f"{name}.torsional_friction", torsion, "none without friction")
        return None, None, MODELS[0]
    coefficient = number(f"{name}.friction", friction, above=0.0)
    if model == "box":
        torsion = coefficient * mean_arm if torsion is None else torsion
        return coefficient, number(f"{name}.torsional_friction", torsion, above=0.0), model
    if torsion is not None:
        raise InputError(f"{name}.torsional_friction", torsion, "none: friction decides it; model='box' has one")
    return coefficient, None, model


def direction_field(field: str, value: ArrayLike | None) -> tuple[float, ...] | None:
    """Return a validated direction as a unit vector (tuple), or None."""
    if value is None:
        return None
    direction = array(field, value, (3,))
    size = float(np.linalg.norm(direction))
    if size <= 0.0:
        raise InputError(field, value, "a direction of some length")
    return tuple((direction if abs(size - 1.0) < 1e-12 else direction / size).tolist())


def rotate_direction(direction: tuple[float, ...] | None, rotation: FloatArray) -> tuple[float, ...] | None:
    """Return a direction in a rotated body frame; unchanged if None or in the plane."""
    return direction if direction is None or len(rotation) == 2 else tuple((rotation @ direction).tolist())


def is_off_normal(direction: tuple[float, ...], normals: FloatArray) -> BoolArray:
    """Return whether a direction is far enough off each unit normal (b, 3) to orient a line or rectangle, (b,)."""
    return np.asarray(np.linalg.norm(np.cross(normals, direction), axis=1) >= LEAST_SINE * np.linalg.norm(direction))


def tangents_along(normals: FloatArray, direction: tuple[float, ...] | None, name: str) -> FloatArray:
    """Return right-handed unit tangents (b, 2, 3) at normals (b, 3), the first along the projected direction.

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
    """Return the two unit tangents at a symbolic normal (3,), the first along the projected direction."""
    import casadi as ca  # numeric use needs none

    if direction is None:
        raise InputError(f"{name}.direction", None, "the line's or rectangle's direction in the body frame")
    d = ca.DM(list(direction))
    first = d - ca.dot(normal, d) * normal
    first = first / ca.sqrt(ca.sumsqr(first) + PARALLEL**2)
    return first, ca.cross(normal, first)


class AlongNormalError(InputError):
    """Error: a contact's direction is parallel to the surface normal, so its tangent is undefined."""
