"""Soft finger contact with Coulomb friction and torsion about the normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts import cones as elliptic_cone
from nlpgrasp.contacts.base import MISSING, Blocks, Work, unit_tangential_forces, upper_triangle
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.errors import InputError

MODELS = ("box", "elliptic")  # shapes of the force domain


@dataclass(frozen=True)
class SoftContact(RangeContact):
    """Soft finger: three force components and a torsion moment (finger III of Example 2-2).

    Parameters
    ----------
    friction : float
        Coulomb coefficient, greater than zero.
    torsional_friction : float
        Largest torsion moment over normal force, metres, greater than zero.
    model : {"box", "elliptic"}
        ``"box"``: ``|f_t| <= mu f_n`` and ``|tau| <= mu_t f_n`` (2.4-1).
        ``"elliptic"``: ``|(f_t / mu, tau / mu_t)| <= f_n``.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "soft"
    friction: float
    torsional_friction: float
    model: str = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("friction", "torsional_friction"):
            object.__setattr__(self, name, number(f"SoftContact.{name}", getattr(self, name), above=0.0))
        if not isinstance(self.model, str) or self.model not in MODELS:
            raise InputError("SoftContact.model", self.model, " or ".join(repr(m) for m in MODELS))

    @property
    def coefficients(self) -> dict[str, float]:
        """Friction coefficients by name: ``friction`` and ``torsional_friction`` (metres)."""
        return {"friction": self.friction, "torsional_friction": self.torsional_friction}

    @property
    def label(self) -> str:
        """Name of the model in tables: ``soft``, or ``elliptic`` for the elliptic cone."""
        return self.kind if self.model == "box" else self.model

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of force and torsion; raise for planar bodies, which admit no torsion."""
        if space == 2:
            raise InputError("contacts", self, "point, friction or line contacts: a planar body has no torsion")
        return (0, 1, 2, 3)

    def blocks(self, components: int) -> Blocks:
        """Return the blocks of friction and torsion with their coefficients.

        For the elliptic cone they are those of the box around it.
        """
        return ((slice(1, 3), self.friction), (slice(3, 4), self.torsional_friction))

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto the force domain."""
        if self.model == "box":
            return super().project(z)
        return elliptic_cone.project_elliptic(z, self.friction, self.torsional_friction)

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, row by row, (n_i (n_i + 1) / 2, ...)."""
        if self.model == "box":
            return super().derivative_entries(z)
        matrix = elliptic_cone.elliptic_projection_jacobian(z, self.friction, self.torsional_friction)
        return np.stack([matrix[..., a, b] for a, b in upper_triangle(4)])

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support along ``z`` (..., n_i) for normal force at most 1, and a maximiser (..., n_i)."""
        if self.model == "box":
            return super().extreme(z)
        return elliptic_cone.elliptic_support(z, self.friction, self.torsional_friction)

    def cones(self, space: int) -> list[FloatArray]:
        """Return the (r, n_i) matrices of the second-order cones that describe the force domain."""
        if self.model == "box":
            return super().cones(space)
        return [np.diag([self.friction, 1.0, 1.0, self.friction / self.torsional_friction])]

    def left_for_moments(self, normal: float, tangential: float) -> float:
        """Return the part of the normal force, newtons, that a tangential force leaves available for torsion.

        All of it for the box, less for the elliptic cone.
        """
        if self.model == "box":
            return normal
        return float(np.sqrt(max(normal**2 - (tangential / self.friction) ** 2, 0.0)))

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return edges of the cone, (m, n_i): evenly spaced tangential forces, each with torsion of both signs."""
        ratio = float(self.friction / self.torsional_friction)  # torsion component equivalent to a unit tangential one
        sign = np.repeat([1.0, -1.0], edges)[:, None]
        tangential = np.tile(unit_tangential_forces(edges, first_edge), (2, 1))
        return self.extreme(np.concatenate([tangential, sign * ratio], axis=1))[1]

    def variables(self, space: int) -> int:
        """Return the number of NLP variables: the force in the body frame and the torsion moment."""
        return self.components(space)

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment from NLP variables: the first three, and the fourth times the normal."""
        return x[:3], x[3] * normal

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return expressions that are all nonnegative if and only if the NLP variables are admissible (symbolic)."""
        force, torsion = x[:3], x[3]
        pressing = normal.T @ force
        sliding = force.T @ force - pressing**2
        if self.model == "box":
            limit = self.torsional_friction * pressing
            cone = [
                ("friction", self.friction**2 * pressing**2 - sliding),
                ("torsion", limit**2 - torsion**2),
            ]
        else:
            weighted_tangential = sliding / self.friction**2 + torsion**2 / self.torsional_friction**2
            cone = [("friction and torsion", pressing**2 - weighted_tangential)]
        return [*cone, ("unilateral", pressing)]

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``||P_K(z)||^2`` for the box model; None for the elliptic cone."""
        if self.model != "box":
            return None
        return squared_box_support(work, self.friction, self.torsional_friction, ops)

    def linear_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return the largest ``<z, x>`` over forces x with unit normal force (symbolic).

        ``z_n + mu |z_t| + mu_t |z_tau|``, or ``z_n + |(mu z_t, mu_t z_tau)|``.
        """
        sliding, turning = self.friction * work.tangential, self.torsional_friction * work.torsion
        return work.normal + (sliding + turning if self.model == "box" else ops.sqrt(sliding**2 + turning**2))

    def to_dict(self) -> Json:
        """Return the model's name and coefficients."""
        return {
            "model": self.kind,
            "friction": self.friction,
            "torsional_friction": self.torsional_friction,
            "torsion_model": self.model,
        }

    @classmethod
    def from_dict(cls, data: Json) -> SoftContact:
        """Return the model from the data of its ``to_dict``."""
        return cls(
            data.get("friction", MISSING), data.get("torsional_friction", MISSING), data.get("torsion_model", "box")
        )


def squared_box_support(work: Work, mu: Expression, mu_t: Expression, ops: Ops) -> Expression:
    """Return ``||P_K(z)||^2`` for the box model of a soft finger, as numbers, arrays or symbols."""
    normal, tangential, torsion = work
    pressing = ops.fmax(normal, 0.0)
    for weight, numerator in (
        (mu**2, normal + mu * tangential),
        (mu_t**2, normal + mu_t * torsion),
        (mu**2 + mu_t**2, normal + mu * tangential + mu_t * torsion),
    ):
        pressing = ops.fmax(pressing, numerator / (1.0 + weight))
    return pressing**2 + ops.fmin(tangential, mu * pressing) ** 2 + ops.fmin(torsion, mu_t * pressing) ** 2
