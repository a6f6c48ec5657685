"""What every force budget states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.common.jointed import JointedHand
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import BilateralContact, ContactModel
from nlpgrasp.errors import InputError

Row = tuple[str, Any, float, float]  # name, expression, lower, upper


class ForceBudget(ABC):
    """A convex set B of finger forces, the unit of force: the grasp wrench set is ``G(B n K)`` (theory, Section 2).

    Finger forces are stacked as in G: contact by contact, each in its frame, normal force first.
    """

    kind: ClassVar[str]
    depends_on_frames: ClassVar[bool] = False
    follows_hand: ClassVar[bool] = False  # whether it is known only with the posture of a hand
    costly: bool = False  # whether a support is a conic program: too slow for the many thousand that nu needs
    limited: ClassVar[str] = ""  # what it limits, where that leaves bilateral contacts without a bound
    power: ClassVar[float] = 2.0  # p, where the support is near the p-norm of the contacts' own supports

    def check(self, contacts: Sequence[ContactModel], space: int) -> None:
        """Raise ``InputError`` on contacts whose forces this budget does not bound, or does not fit."""
        if self.limited and any(isinstance(c, BilateralContact) for c in contacts):
            raise InputError("force_budget", self.limited, '"l2" with bilateral contacts')

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> ForceBudget:
        """Return the budget for contacts with these frames, (k, space, space), axes as columns, normal first."""
        return self

    def check_hand(self, hand: JointedHand | None) -> None:
        """Raise ``InputError`` on hands of which this budget cannot say what they can exert."""
        del hand

    def posed(self, hand: JointedHand | None, values: Mapping[str, FloatArray], points: FloatArray) -> ForceBudget:
        """Return the budget for contacts at points (k, space) of a hand with these values of its variables."""
        return self

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[tuple[Any, Any, Any]], ops: Any
    ) -> tuple[Any, int] | None:
        """Return a smooth closed form of the support function (symbolic), or ``None`` where there is none.

        Parameters
        ----------
        contacts : sequence of k ContactModel
        work : sequence of k triples
            ``z_n``, ``|z_t|`` and ``|z_torsion|`` of each contact.
        ops : module
            ``numpy`` or ``casadi``.

        Returns
        -------
        expression, degree
            ``phi`` itself, degree 1, or its square, degree 2.
        """
        return None

    def pieces(
        self, contacts: Sequence[ContactModel], work: Sequence[tuple[Any, Any, Any]], ops: Any
    ) -> list[Any] | None:
        """Return smooth functions whose largest is the support (symbolic), one a contact, or ``None``.

        For supports with kinks; arguments as in ``closed_form``.
        """
        return None

    def force_scale(self) -> float:
        """Return the size of force the budget allows, newtons: the program's unit of force."""
        return 1.0

    @abstractmethod
    def support(self, z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
        """Return ``max <z, x>`` over x in B n K, exactly, and a force that attains it: (m, n) to (m,) and (m, n)."""

    @abstractmethod
    def used(self, x: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
        """Return the least factor f with x in f B, for forces of K: (m, n) to (m,)."""

    @abstractmethod
    def cones(self, contacts: Sequence[ContactModel], space: int) -> list[FloatArray]:
        """Return matrices M: x is in f B where every ``M (x, f)`` is in a second-order cone (one row: at least 0)."""

    @abstractmethod
    def rows(self, contacts: Sequence[ContactModel], forces: Sequence[Any], normals: Sequence[Any]) -> list[Row]:
        """Return the budget's rows on the program's force variables (symbolic): name, expression, lower, upper."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ForceBudget) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(str(self.to_dict()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def to_dict(self) -> str | dict[str, Any]:
        """Return the budget as JSON data: its name alone where it has no parameters."""
        return self.kind


SMOOTH = 1e-8  # under the root that rounds the kinks of a closed form


def ranges(contacts: Sequence[ContactModel], space: int) -> list[slice]:
    """Return where each contact's components are among all finger forces."""
    ends = np.cumsum([0] + [c.components(space) for c in contacts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def extremes(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
    """Return each contact's largest work of unit normal force, (m, k), and the forces, (m, n)."""
    if all(c == contacts[0] for c in contacts):
        shape = (len(z), len(contacts), contacts[0].components(space))
        values, forces = contacts[0].extreme(z.reshape(shape))
        return values, forces.reshape(z.shape)
    parts = [c.extreme(z[:, where]) for c, where in zip(contacts, ranges(contacts, space), strict=True)]
    return np.stack([p[0] for p in parts], axis=1), np.concatenate([p[1] for p in parts], axis=1)


def project(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return the projection of finger forces (m, n) onto the force domain K, the product of the contacts'."""
    if all(c == contacts[0] for c in contacts):
        shape = (len(z), len(contacts), contacts[0].components(space))
        return contacts[0].project(z.reshape(shape)).reshape(z.shape)
    parts = [c.project(z[:, where]) for c, where in zip(contacts, ranges(contacts, space), strict=True)]
    return np.concatenate(parts, axis=1)
