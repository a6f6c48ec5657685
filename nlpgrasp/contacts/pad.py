"""What line and plane contacts share: optional friction, by Coulomb's law or as the paper's box."""

from __future__ import annotations

from abc import abstractmethod
from functools import lru_cache

import numpy as np

from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts.cones.friction_points import FrictionPoints
from nlpgrasp.contacts.cones.range_cone import RangeContact
from nlpgrasp.contacts.direction import symbolic_tangents
from nlpgrasp.errors import InputError

MODELS = ("coulomb", "box")
Friction = tuple[float | None, float | None, str]  # coefficient, torsion, model
Arms = tuple[tuple[float, float], ...]

friction_points = lru_cache(maxsize=256)(FrictionPoints)  # equal contacts share what they have computed


class PadContact(RangeContact):
    """A contact over a line or a pad, whose pressure may move.

    Without friction, and in the plane, the box of ranges is what point contacts at the ends or corners can do. With
    friction in space the model says which it is: ``"coulomb"``, the friction contacts at the ends or corners
    (docs/paper/02_contacts.md), or the ``"box"`` of (2.4-1).
    """

    friction: float | None
    torsional_friction: float | None
    direction: tuple[float, float, float] | None
    model: str | None

    @property
    @abstractmethod
    def arms(self) -> Arms:
        """Ends or corners along both tangents from the contact point, metres."""

    @abstractmethod
    def box_split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return the force and the moment of the box's NLP variables (symbolic, body frame)."""

    @abstractmethod
    def box_membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return what is non-negative in the box (symbolic)."""

    @abstractmethod
    def box_variables(self, space: int) -> int:
        """Return how many NLP variables the box has."""

    @property
    def label(self) -> str:
        """Name of the model in tables, which tells the box from Coulomb's law."""
        return f"{self.kind} (box)" if self.friction is not None and self.model == "box" else self.kind

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients ``friction`` and, of the box, ``torsional_friction`` (metres) by their names."""
        both = {"friction": self.friction, "torsional_friction": self.torsional_friction}
        return {name: value for name, value in both.items() if value is not None}

    def points(self, components: int) -> FrictionPoints | None:
        """Return the friction contacts at the ends or corners, where the force domain is theirs and not a box."""
        if self.friction is None or self.model == "box" or components < 5:  # fewer: in the plane
            return None
        return friction_points(self.arms, self.friction, self.axes(3))

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto the force domain."""
        points = self.points(z.shape[-1])
        return super().project(z) if points is None else points.project(z)

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, (n_i (n_i + 1) / 2, ...)."""
        points = self.points(z.shape[-1])
        return super().derivative_entries(z) if points is None else points.derivative_entries(z)

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest work of unit normal force for ``z`` (..., n_i), and the force that does it, (..., n_i)."""
        points = self.points(z.shape[-1])
        return super().extreme(z) if points is None else points.extreme(z)

    def generators(self, space: int) -> FloatArray:
        """Return A, (n_i, m): the components of forces at the ends or corners, or the identity."""
        points = self.points(self.components(space))
        return super().generators(space) if points is None else points.generators

    def cones(self, space: int) -> list[FloatArray]:
        """Return (r, m) matrices: the friction cone of every end or corner, or the cones of the box."""
        points = self.points(self.components(space))
        return super().cones(space) if points is None else points.cones()

    def variables(self, space: int) -> int:
        """Return how many NLP variables there are: those of the box, or a force in the body frame an end or corner."""
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
        """Return the force and the moment about the contact point of NLP variables (symbolic, body frame)."""
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
        """Return the conditions of the box, or of friction at every end or corner (symbolic)."""
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
        """Return the squared length of the force components of NLP variables: force and moment together."""
        if self._is_box(normal):
            return super().squared_size(x, normal)
        force, moment = self.split(x, normal)
        return force.T @ force + moment.T @ moment

    def symbolic_tangents(self, normal: Expression) -> tuple[Expression, Expression]:
        """Return the two unit tangents at a symbolic normal (3,), those of ``tangents``."""
        return symbolic_tangents(normal, self.direction, type(self).__name__)

    def _is_box(self, normal: Expression) -> bool:
        return self.points(self.components(int(normal.shape[0]))) is None


def friction_fields(
    name: str, friction: float | None, torsion: float | None, model: object, mean_arm: float
) -> Friction:
    """Return the checked coefficients and model; torsion that the box lacks is that of even pressure, ``mu mean_arm``.

    Contacts without friction are all of their default model.
    """
    if not isinstance(model, str) or model not in MODELS:
        raise InputError(f"{name}.model", model, " or ".join(repr(m) for m in MODELS))
    if friction is None:
        if torsion is not None:
            raise InputError(f"{name}.torsional_friction", torsion, "none without friction")
        return None, None, MODELS[0]
    checked = number(f"{name}.friction", friction, above=0.0)
    if model == "box":
        torsion = checked * mean_arm if torsion is None else torsion
        return checked, number(f"{name}.torsional_friction", torsion, above=0.0), model
    if torsion is not None:
        raise InputError(f"{name}.torsional_friction", torsion, "none: friction decides it; model='box' has one")
    return checked, None, model
