"""Plane contact: a flat pad on a flat face (Salisbury's planar contact)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts.base import Blocks, ContactModel
from nlpgrasp.contacts.pad import Arms, PadContact, direction_field, friction_fields, rotate_direction, tangents_along
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class PlaneContact(PadContact):
    """Plane contact: a disc or rectangle with any pressure distribution, which also exerts tilting moments.

    Without friction 3 components ``(f_n, m_t1, m_t2)``; with friction all 6. The centre of pressure stays on the pad:
    ``|m_t| <= radius f_n`` on a disc, ``|m_t2| <= a / 2 f_n`` and ``|m_t1| <= b / 2 f_n`` on a rectangle a by b,
    equivalent to point contacts all over it. With friction the force domain of a rectangle is that of friction contacts
    at its corners, which is Coulomb's law under any pressure; or, with ``model="box"``, the box of (2.4-1). A disc has
    the box only, since the friction cones of its rim are infinitely many; a rectangle inside it is an inner
    approximation.

    Parameters
    ----------
    radius : float, optional
        Of a disc, metres. Either this or ``extents``.
    extents : (2,) array, optional
        Sides of a rectangle, metres, the first along ``direction``.
    friction : float, optional
        Coulomb coefficient; frictionless by default.
    torsional_friction : float, optional
        Only for the box: largest moment about the normal over normal force, metres; by default that of uniform
        pressure.
    direction : (3,) array, optional
        Of the rectangle's first side, body frame; its tangential part counts. Instead, a ``Grasp`` may be given
        tangents.
    model : {"coulomb", "box"}, optional
        With friction: ``"coulomb"``, the default of rectangles and only theirs: friction contacts at the corners;
        ``"box"``, the only one of discs: ``|f_t| <= mu f_n``, ``|m_n| <= mu_t f_n`` and tilting, each by itself.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "plane"
    radius: float | None = None
    extents: tuple[float, float] | None = None
    friction: float | None = None
    torsional_friction: float | None = None
    direction: tuple[float, float, float] | None = None
    model: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.radius is None) == (self.extents is None):
            raise InputError("PlaneContact", f"radius {self.radius}, extents {self.extents}", "one of the two")
        if self.radius is not None:
            object.__setattr__(self, "radius", number("PlaneContact.radius", self.radius, above=0.0))
        else:
            sides = array("PlaneContact.extents", self.extents if self.extents is not None else (), (2,))
            object.__setattr__(
                self, "extents", tuple(number("PlaneContact.extents", s, above=0.0) for s in sides.tolist())
            )
        if self.radius is not None and self.friction is not None and self.model == "coulomb":
            raise InputError("PlaneContact.model", self.model, "'box' for a disc: only rectangles have corners")
        default = "coulomb" if self.radius is None else "box"
        fields = (self.friction, self.torsional_friction, default if self.model is None else self.model)
        friction, torsion, model = friction_fields("PlaneContact", *fields, self._mean_arm())
        object.__setattr__(self, "friction", friction)
        object.__setattr__(self, "torsional_friction", torsion)
        object.__setattr__(self, "model", default if friction is None else model)
        object.__setattr__(self, "direction", direction_field("PlaneContact.direction", self.direction))

    def _mean_arm(self) -> float:
        """Return the mean distance of the pad's points from its centre, metres.

        It is torsion over friction under uniform pressure.
        """
        if self.extents is None:
            return 2.0 / 3.0 * (self.radius or 0.0)
        a, b = self.extents
        return float(2.0 * np.hypot(a, b) + b**2 / a * np.arcsinh(a / b) + a**2 / b * np.arcsinh(b / a)) / 12.0

    @property
    def arms(self) -> Arms:
        """Positions of the rectangle's corners along its sides, relative to its centre, metres."""
        a, b = self.extents or (0.0, 0.0)
        return tuple((0.5 * a * i, 0.5 * b * j) for i in (1.0, -1.0) for j in (1.0, -1.0))

    @property
    def sides(self) -> tuple[float, float]:
        """Sides of the rectangle, or of the square of the disc's area, metres."""
        side = float(np.sqrt(np.pi)) * (self.radius or 0.0)
        return self.extents or (side, side)

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of the wrench components: 3 without friction, 6 with friction."""
        if space == 2:
            raise InputError("contacts", self, "point, friction or line contacts on a planar body")
        return (0, 4, 5) if self.friction is None else (0, 1, 2, 3, 4, 5)

    def isotropic_relaxation(self, space: int) -> ContactModel:
        """Return the disc itself, or the disc contact around the rectangle."""
        return self if self.extents is None else enclosing_disc(self)

    def blocks(self, components: int) -> Blocks:
        """Return the blocks of friction, torsion and tilting moments with their coefficients.

        Under Coulomb's law, the coefficient of a block is its range with the others at zero.
        """
        first = components - 2
        if self.extents is None:
            tilting: Blocks = ((slice(first, first + 2), self.radius or 0.0),)
        else:
            a, b = self.extents
            tilting = ((slice(first, first + 1), 0.5 * b), (slice(first + 1, first + 2), 0.5 * a))
        if self.friction is None:
            return tilting
        torsion = self.torsional_friction
        if torsion is None:
            torsion = self.friction * max(float(np.hypot(*arm)) for arm in self.arms)
        return ((slice(1, 3), self.friction), (slice(3, 4), torsion), *tilting)

    @property
    def needs_tangents(self) -> bool:
        """Whether the pad is a rectangle whose direction has not been given."""
        return self.extents is not None and self.direction is None

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return unit tangents (b, 2, 3) along the rectangle's sides at inward normals (b, 3); for a disc, any."""
        return (
            any_tangents(normals) if self.extents is None else tangents_along(normals, self.direction, "PlaneContact")
        )

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact in a rotated body frame."""
        changes: Json = {"direction": rotate_direction(self.direction, rotation)}
        return replace(self, **changes)

    def box_variables(self, space: int) -> int:
        """Return the number of NLP variables of the box model.

        They are the force in the body frame and the torsion, or without friction the force's size alone, and a vector v
        (3,) that gives the tilting moment ``n x v``.
        """
        return 4 if self.friction is None else 7

    def box_split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment from the NLP variables of the box model (symbolic, body frame)."""
        import casadi as ca  # numeric use needs none

        if self.friction is None:
            return x[0] * normal, ca.cross(normal, x[1:4])
        return x[:3], x[3] * normal + ca.cross(normal, x[4:7])

    def box_membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return expressions, all nonnegative if and only if the NLP variables of the box model are admissible."""
        import casadi as ca

        pressing = self.normal_force(x, normal)
        tilting = ca.cross(normal, x[x.shape[0] - 3 :])
        rows = [("unilateral", pressing)]
        if self.extents is None:
            rows.append(("tilting", ((self.radius or 0.0) * pressing) ** 2 - ca.sumsqr(tilting)))
        else:
            first, second = self.symbolic_tangents(normal)
            a, b = self.extents
            rows.append(("tilting about the first side", (0.5 * b * pressing) ** 2 - ca.dot(tilting, first) ** 2))
            rows.append(("tilting about the second side", (0.5 * a * pressing) ** 2 - ca.dot(tilting, second) ** 2))
        if self.friction is not None and self.torsional_friction is not None:
            sliding = ca.sumsqr(x[:3]) - pressing**2
            rows.append(("friction", (self.friction * pressing) ** 2 - sliding))
            rows.append(("torsion", (self.torsional_friction * pressing) ** 2 - x[3] ** 2))
        return rows

    def to_dict(self) -> Json:
        """Return the model's name, pad, coefficients, direction and friction model as JSON data."""
        return {
            "model": self.kind,
            "radius": self.radius,
            "extents": None if self.extents is None else list(self.extents),
            "friction": self.friction,
            "torsional_friction": self.torsional_friction,
            "direction": None if self.direction is None else list(self.direction),
            "friction_model": None if self.friction is None else self.model,
        }

    @classmethod
    def from_dict(cls, data: Json) -> PlaneContact:
        """Return the model from the data of its ``to_dict``; without ``friction_model``, the box model."""
        names = ("radius", "extents", "friction", "torsional_friction", "direction")
        model = data.get("friction_model")
        return cls(**{name: data.get(name) for name in names}, model="box" if model is None else model)


def enclosing_disc(pad: PadContact) -> PlaneContact:
    """Return the disc contact around a line or rectangle, whose force domain contains the pad's.

    With the largest arm r of the pad's ends or corners, ``|m_t| <= r f_n`` follows from their normal forces, and
    ``|m_n| <= mu r f_n`` from their friction; the box states its torsion.
    """
    radius, torsion = max(float(np.hypot(*arm)) for arm in pad.arms), pad.torsional_friction
    if pad.friction is not None and torsion is None:
        torsion = pad.friction * radius
    return PlaneContact(radius=radius, friction=pad.friction, torsional_friction=torsion)
