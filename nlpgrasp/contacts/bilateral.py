"""Bilateral contact, such as glue, suction or a clamp: unrestricted force components."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import ContactModel, Work, contact_from_dict, upper_triangle
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class BilateralContact(ContactModel):
    """Bilateral contact, which can push and pull: ``K_i = R^n``.

    See Proposition 2-7, (3.1-1a) and (3.2-2).

    Parameters
    ----------
    model : ContactModel
        Determines the force components; its coefficients have no effect.
    """

    kind: ClassVar[str] = "bilateral"
    unilateral: ClassVar[bool] = False
    model: ContactModel

    def __post_init__(self) -> None:
        if not isinstance(self.model, ContactModel) or isinstance(self.model, BilateralContact):
            raise InputError("BilateralContact.model", self.model, "a contact model such as ng.FrictionContact")
        object.__setattr__(self, "faces", self.model.faces if self.faces is None else self.faces)
        super().__post_init__()

    @property
    def coefficients(self) -> dict[str, float]:
        """Friction coefficients, of which there are none: nothing limits the forces."""
        return {}

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of the wrapped model's wrench components, normal force first."""
        return self.model.axes(space)

    @property
    def needs_tangents(self) -> bool:
        """Whether the wrapped contact model needs a tangent direction that has not been given."""
        return self.model.needs_tangents

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return the wrapped model's unit tangents (b, space - 1, space) at inward normals (b, space)."""
        return self.model.tangents(normals)

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact in a rotated body frame."""
        return replace(self, model=self.model.turned(rotation))

    def project(self, z: FloatArray) -> FloatArray:
        """Return ``z`` (..., n_i) itself: every force is in ``K_i``."""
        return z.copy()

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the identity, (n_i (n_i + 1) / 2, ...)."""
        return np.stack([np.full(z.shape[:-1], float(a == b)) for a, b in upper_triangle(z.shape[-1])])

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Raise: limits on the normal force leave the other components (..., n_i) unbounded."""
        raise InputError("force_budget", "limits on normal force", '"l2" with bilateral contacts')

    def cones(self, space: int) -> list[FloatArray]:
        """Return an empty list of matrices (m, n_i), as every force is admissible."""
        return []

    def variables(self, space: int) -> int:
        """Return the number of NLP variables of the wrapped model's force."""
        return self.model.variables(space)

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the wrapped model's NLP variables of a unit force along the inward normal ``(space,)``."""
        return self.model.pressing(normal)

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment of the wrapped model from NLP variables (symbolic, body frame)."""
        return self.model.split(x, normal)

    def normal_force(self, x: Expression, normal: Expression) -> Expression:
        """Return the wrapped model's normal force, given NLP variables ``x`` (symbolic)."""
        return self.model.normal_force(x, normal)

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return an empty list: every force is in ``K_i``."""
        return []

    def squared_size(self, x: Expression, normal: Expression) -> Expression:
        """Return the squared norm of the wrapped model's force components (symbolic)."""
        return self.model.squared_size(x, normal)

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``||z||^2`` over the model's components; None if there are moments about tangents."""
        if any(axis > 3 for axis in self.axes(3)):
            return None
        count = self.components(3)
        sliding, turning = (work.tangential**2 if count >= 3 else 0.0), (work.torsion**2 if count >= 4 else 0.0)
        return work.normal**2 + sliding + turning

    def to_dict(self) -> Json:
        """Return the contact as JSON data, with the wrapped model under ``of``."""
        return {"model": self.kind, "of": self.model.to_dict()}

    @classmethod
    def from_dict(cls, data: Json) -> BilateralContact:
        """Return the contact from the data of its ``to_dict``."""
        return cls(contact_from_dict(data.get("of", {})))
