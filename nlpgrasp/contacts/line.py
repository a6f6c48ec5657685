"""Line contact: an edge, or a flat finger across a bar (Salisbury's line contact)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts.base import MISSING
from nlpgrasp.contacts.cones.range_cone import RangeContact
from nlpgrasp.contacts.cones.terms import Blocks
from nlpgrasp.contacts.direction import direction_field, symbolic_tangents, tangents_along, turned_direction
from nlpgrasp.contacts.pad import friction_coefficients, friction_fields, pressing_variables


@dataclass(frozen=True)
class LineContact(RangeContact):
    """A segment of contact: the pressure may move along it, so it also resists a moment across the line.

    Without friction 2 components ``(f_n, m_t2)``; with friction 5, all but the moment about the line (in the plane
    2 and 3, with the moment m). The pressure's centre stays on the segment: ``|m_t2| <= length / 2 f_n``, exactly what
    point contacts at the two ends can do. With friction the model is the box of (2.4-1), ``|f_t| <= mu f_n`` and
    ``|m_n| <= mu_t f_n``; what Coulomb's law leaves of it is the wrenches of friction contacts at the two ends.

    Parameters
    ----------
    length : float
        Metres, greater than zero.
    friction : float, optional
        Coulomb coefficient; frictionless when left out.
    torsional_friction : float, optional
        Greatest moment about the normal over normal force, metres; that of even pressure, ``mu length / 4``, when
        left out.
    direction : (3,) array, optional
        The line's direction, body frame; its part along the surface counts. In place of it a
        ``Grasp`` may be given tangents, the first of them along the line.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "line"
    length: float
    friction: float | None = None
    torsional_friction: float | None = None
    direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "length", number("LineContact.length", self.length, above=0.0))
        friction, torsion = friction_fields("LineContact", self.friction, self.torsional_friction, self.length / 4.0)
        object.__setattr__(self, "friction", friction)
        object.__setattr__(self, "torsional_friction", torsion)
        object.__setattr__(self, "direction", direction_field("LineContact.direction", self.direction))

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients ``friction`` and ``torsional_friction`` (metres) by their names; none without friction."""
        return friction_coefficients(self.friction, self.torsional_friction)

    def axes(self, space: int) -> tuple[int, ...]:
        """Return 2 components without friction, 5 with (3 in the plane)."""
        if space == 2:
            return (0, 2) if self.friction is None else (0, 1, 2)
        return (0, 5) if self.friction is None else (0, 1, 2, 3, 5)

    def blocks(self, components: int) -> Blocks:
        """Return the moment's range, after those of friction and torsion."""
        half = 0.5 * self.length
        if self.friction is None or self.torsional_friction is None:
            return ((slice(1, 2), half),)
        if components == 3:
            return ((slice(1, 2), self.friction), (slice(2, 3), half))
        return ((slice(1, 3), self.friction), (slice(3, 4), self.torsional_friction), (slice(4, 5), half))

    @property
    def needs_tangents(self) -> bool:
        """Whether the line's direction was left out."""
        return self.direction is None

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return unit tangents (b, 2, 3), the first along the line, at contacts with inward normals (b, 3)."""
        return tangents_along(normals, self.direction, "LineContact")

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact with its direction in the turned frame."""
        changes: Json = {"direction": turned_direction(self.direction, rotation)}
        return replace(self, **changes)

    def variables(self, space: int) -> int:
        """Return how many NLP variables there are: the force in the body frame (or its size), then the moments."""
        return self.components(space)

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variables of a unit force along the normal ``(space,)`` and no moment."""
        return pressing_variables(normal, self.friction is not None, self.variables(len(normal)))

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return the force, and the moments about the normal and across the line."""
        force = x[0] * normal if self.friction is None else x[: normal.shape[0]]
        if normal.shape[0] == 2:
            return force, x[x.shape[0] - 1]
        across = symbolic_tangents(normal, self.direction, "LineContact")[1]
        if self.friction is None:
            return force, x[1] * across
        return force, x[3] * normal + x[4] * across

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return the ranges of friction, torsion and moment, squared, and the unilateral condition."""
        pressing = self.normal_force(x, normal)
        last = x[x.shape[0] - 1]
        rows = [("moment", (0.5 * self.length * pressing) ** 2 - last**2), ("unilateral", pressing)]
        if self.friction is None or self.torsional_friction is None:
            return rows
        force = x[: normal.shape[0]]
        sliding = force.T @ force - pressing**2
        rows.insert(0, ("friction", (self.friction * pressing) ** 2 - sliding))
        if normal.shape[0] == 3:
            rows.insert(1, ("torsion", (self.torsional_friction * pressing) ** 2 - x[3] ** 2))
        return rows

    def to_dict(self) -> Json:
        """Return the model's name, length, coefficients and direction."""
        return {
            "model": self.kind,
            "length": self.length,
            "friction": self.friction,
            "torsional_friction": self.torsional_friction,
            "direction": None if self.direction is None else list(self.direction),
        }

    @classmethod
    def from_dict(cls, data: Json) -> LineContact:
        """Return the model that ``to_dict`` wrote."""
        return cls(
            data.get("length", MISSING), data.get("friction"), data.get("torsional_friction"), data.get("direction")
        )
