"""Line contact, such as an edge or a flat finger across a bar (Salisbury's line contact)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import BoolArray, FloatArray, number
from nlpgrasp.contacts.base import MISSING, Blocks, ContactModel
from nlpgrasp.contacts.pad import Arms, PadContact, direction_field, friction_fields, rotate_direction, tangents_along
from nlpgrasp.contacts.plane import enclosing_disc

MORE, HALVINGS = 1e-7, 40  # correction of projections: largest relative increase of forces; bisection steps

LINE_WIDTH = 1e-4  # metres: of the strip of surface under a line


@dataclass(frozen=True)
class LineContact(PadContact):
    """Line contact: a segment with any pressure distribution, which also exerts a moment across the line.

    Without friction 2 components ``(f_n, m_t2)``; with friction 5, all but the moment about the line (in the plane
    2 and 3, with the moment m). The centre of pressure stays on the segment: ``|m_t2| <= length / 2 f_n``, equivalent
    to point contacts at the two ends. With friction the force domain is that of friction contacts at the two ends,
    which is Coulomb's law under any pressure; or, with ``model="box"``, the box of (2.4-1).

    Parameters
    ----------
    length : float
        Metres, greater than zero.
    friction : float, optional
        Coulomb coefficient; frictionless by default.
    torsional_friction : float, optional
        Only for the box: largest moment about the normal over normal force, metres; by default that of uniform
        pressure, ``mu length / 4``.
    direction : (3,) array, optional
        Of the line, body frame; its tangential part counts. Instead, a ``Grasp`` may be given tangents, the first
        along the line.
    model : {"coulomb", "box"}
        With friction: ``"coulomb"``, friction contacts at both ends; ``"box"``: ``|f_t| <= mu f_n``,
        ``|m_n| <= mu_t f_n`` and ``|m_t2| <= length / 2 f_n``, each by itself. In the plane both are the same.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "line"
    length: float
    friction: float | None = None
    torsional_friction: float | None = None
    direction: tuple[float, float, float] | None = None
    model: str = "coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "length", number("LineContact.length", self.length, above=0.0))
        fields = (self.friction, self.torsional_friction, self.model)
        friction, torsion, model = friction_fields("LineContact", *fields, self.length / 4.0)
        object.__setattr__(self, "friction", friction)
        object.__setattr__(self, "torsional_friction", torsion)
        object.__setattr__(self, "model", type(self).model if friction is None else model)
        object.__setattr__(self, "direction", direction_field("LineContact.direction", self.direction))

    @property
    def arms(self) -> Arms:
        """Positions of the ends of a line contact along its line, relative to the contact point, metres."""
        half = 0.5 * self.length
        return (half, 0.0), (-half, 0.0)

    @property
    def sides(self) -> tuple[float, float]:
        """Length of the line and a small width, metres."""
        return self.length, LINE_WIDTH

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of the wrench components: 2 without friction, 5 with friction (3 in the plane)."""
        if space == 2:
            return (0, 2) if self.friction is None else (0, 1, 2)
        return (0, 5) if self.friction is None else (0, 1, 2, 3, 5)

    def isotropic_relaxation(self, space: int) -> ContactModel:
        """Return the disc contact around the line in three dimensions; the contact itself in two."""
        return self if space == 2 else enclosing_disc(self)

    def blocks(self, components: int) -> Blocks:
        """Return the blocks of friction, torsion and moment with their coefficients.

        Under Coulomb's law, the coefficient of a block is its range with the others at zero.
        """
        half = 0.5 * self.length
        if self.friction is None:
            return ((slice(1, 2), half),)
        if components == 3:
            return ((slice(1, 2), self.friction), (slice(2, 3), half))
        torsion = self.friction * half if self.torsional_friction is None else self.torsional_friction
        return ((slice(1, 3), self.friction), (slice(3, 4), torsion), (slice(4, 5), half))

    @property
    def needs_tangents(self) -> bool:
        """Whether the direction of the line has not been given."""
        return self.direction is None

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return unit tangents (b, 2, 3), the first along the line, at contacts with inward normals (b, 3)."""
        return tangents_along(normals, self.direction, "LineContact")

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact in a rotated body frame."""
        changes: Json = {"direction": rotate_direction(self.direction, rotation)}
        return replace(self, **changes)

    def into(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto ``K_i``, moved inside if numerical errors leave it outside.

        Coulomb's law at the ends holds if the force along the line satisfies ``|x_1| <= sum of
        sqrt((mu n_i + t)^2 - c_i^2)`` with t = 0, for the ends' normal forces n_i and forces across c_i. The least
        ``t >= 0`` that satisfies it, about 1e-9 for an iterative projection, gives the normal force ``t / mu`` to add
        at each end.
        """
        x = self.project(z)
        if self.friction is None or self.points(z.shape[-1]) is None:
            return x
        half, size = 0.5 * self.length, np.linalg.norm(x, axis=-1)
        limits = 0.5 * self.friction * np.stack([x[..., 0] - x[..., 4] / half, x[..., 0] + x[..., 4] / half])
        transverse = 0.5 * np.abs(np.stack([x[..., 2] + x[..., 3] / half, x[..., 2] - x[..., 3] / half]))
        low, high = np.zeros_like(size), MORE * size
        for _ in range(HALVINGS):
            t = np.where(low == high, low, 0.5 * (low + high))
            is_sufficient = self._supports_force(x, limits + t, transverse)
            low, high = np.where(is_sufficient, low, t), np.where(is_sufficient, t, high)
        needs_more = ~self._supports_force(x, limits, transverse) & self._supports_force(x, limits + high, transverse)
        x[..., 0] += np.where(needs_more, 2.0 * high / self.friction, 0.0)
        return x

    @staticmethod
    def _supports_force(x: FloatArray, limits: FloatArray, transverse: FloatArray) -> BoolArray:
        """Return whether friction at both ends of the line suffices for contact forces (..., 5).

        ``limits`` and ``transverse`` (2, ...) are the friction limit and the size of the force across, at each end.
        """
        capacity = np.sqrt(np.maximum((limits - transverse) * (limits + transverse), 0.0)).sum(axis=0)
        return np.asarray(np.all(limits >= transverse, axis=0) & (np.abs(x[..., 1]) <= capacity))

    def box_variables(self, space: int) -> int:
        """Return the number of NLP variables of the box model.

        They are the force in the body frame, or its size without friction, and the moments.
        """
        return self.components(space)

    def box_split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment from the NLP variables of the box model (symbolic, body frame)."""
        force = x[0] * normal if self.friction is None else x[: normal.shape[0]]
        if normal.shape[0] == 2:
            return force, x[x.shape[0] - 1]
        transverse = self.symbolic_tangents(normal)[1]
        if self.friction is None:
            return force, x[1] * transverse
        return force, x[3] * normal + x[4] * transverse

    def box_membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return expressions, all nonnegative if and only if the NLP variables of the box model are admissible."""
        pressing = self.normal_force(x, normal)
        last = x[x.shape[0] - 1]
        rows = [("moment", (0.5 * self.length * pressing) ** 2 - last**2), ("unilateral", pressing)]
        if self.friction is None:
            return rows
        force = x[: normal.shape[0]]
        sliding = force.T @ force - pressing**2
        rows.insert(0, ("friction", (self.friction * pressing) ** 2 - sliding))
        if normal.shape[0] == 3 and self.torsional_friction is not None:
            rows.insert(1, ("torsion", (self.torsional_friction * pressing) ** 2 - x[3] ** 2))
        return rows

    def to_dict(self) -> Json:
        """Return the model's name, length, coefficients, direction and friction model as JSON data."""
        return {
            "model": self.kind,
            "length": self.length,
            "friction": self.friction,
            "torsional_friction": self.torsional_friction,
            "direction": None if self.direction is None else list(self.direction),
            "friction_model": None if self.friction is None else self.model,
        }

    @classmethod
    def from_dict(cls, data: Json) -> LineContact:
        """Return the model from the data of its ``to_dict``; without ``friction_model``, the box model."""
        fields = {name: data.get(name) for name in ("friction", "torsional_friction", "direction")}
        model = data.get("friction_model")
        return cls(data.get("length", MISSING), **fields, model="box" if model is None else model)
