"""Point contact with Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts.base import MISSING, Blocks, Work, unit_tangential_forces
from nlpgrasp.contacts.cones import RangeContact


@dataclass(frozen=True)
class FrictionContact(RangeContact):
    """Point contact with Coulomb friction: ``|f_t| <= friction f_n`` (finger II of Example 2-2, (2.4-1)).

    Parameters
    ----------
    friction : float
        Coulomb coefficient, greater than zero.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "friction"
    friction: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "friction", number("FrictionContact.friction", self.friction, above=0.0))

    @property
    def coefficients(self) -> dict[str, float]:
        """Friction coefficient by name: ``friction``."""
        return {"friction": self.friction}

    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of normal and tangential forces: three in space, two in the plane."""
        return tuple(range(space))

    def blocks(self, components: int) -> Blocks:
        """Return one block: the tangential forces, with the friction coefficient."""
        return ((slice(1, components), self.friction),)

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return evenly spaced edges of the friction cone, (m, n_i), as forces with unit normal force."""
        if components == 2:
            return self.extreme(np.array([[0.0, 1.0], [0.0, -1.0]]))[1]
        return self.extreme(unit_tangential_forces(edges, first_edge))[1]

    def variables(self, space: int) -> int:
        """Return the number of NLP variables, a force in the body frame: 3 in space, 2 in the plane."""
        return space

    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return the force ``x`` itself and no moment: the NLP variables are the force in the body frame."""
        return x, None

    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return ``(1 + mu^2)(f.n)^2 - |f|^2`` and ``f.n``, both nonnegative in the friction cone.

        They need no tangents, which are singular at some normal.
        """
        pressing = normal.T @ x
        return [("friction", (1.0 + self.friction**2) * pressing**2 - x.T @ x), ("unilateral", pressing)]

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``||P_K(z)||^2`` in closed form.

        It is the sum of the squared parts of ``(z_n, |z_t|)`` along the cone's edge ``(c, mu c)``, with
        c = 1/sqrt(1 + mu^2), and across it towards the inside, each clipped at zero.
        """
        c2 = 1.0 / (1.0 + self.friction**2)
        on_edge = ops.fmax(work.normal + self.friction * work.tangential, 0.0)
        inward = ops.fmax(self.friction * work.normal - work.tangential, 0.0)
        return c2 * (on_edge**2 + inward**2)

    def linear_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``z_n + friction |z_t|``, the largest ``<z, x>`` over forces x with unit normal force."""
        return work.normal + self.friction * work.tangential

    def to_dict(self) -> Json:
        """Return the model's name and coefficient."""
        return {"model": self.kind, "friction": self.friction}

    @classmethod
    def from_dict(cls, data: Json) -> FrictionContact:
        """Return the model from the data of its ``to_dict``."""
        return cls(data.get("friction", MISSING))
