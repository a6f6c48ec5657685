"""Base classes of force budgets and of the force sets ``B ∩ K`` that they define."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import ClassVar

from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, HandWithJacobians, JointedHand, Json, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.product import component_slices, conic_lift, is_lifted, project_lifted
from nlpgrasp.errors import InputError

SMOOTH = 1e-8  # under square roots, which smooths the kinks of closed forms


class ForceSet(ABC):
    """Force set ``B ∩ K``: admissible contact forces within one unit of a budget, (2.5-2).

    Forces are stacked as in G: n components, contact by contact, each in its frame, normal force first.

    Parameters
    ----------
    contacts : sequence of k ContactModel
        Their force domains form K.
    space : int
        Dimension of the contacts' points: 2 or 3.
    """

    power: ClassVar[float] = 2.0  # p for which the support function is close to the p-norm of the contacts' supports

    def __init__(self, contacts: Sequence[ContactModel], space: int) -> None:
        self.contacts, self.space = tuple(contacts), space
        self.ranges = component_slices(self.contacts, space)

    @property
    def size(self) -> int:
        """Number n of force components."""
        return sum(c.components(self.space) for c in self.contacts)

    @property
    def costly(self) -> bool:
        """Whether each support evaluation solves a conic program.

        That is too slow for the many thousand that nu needs.
        """
        return False

    @abstractmethod
    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the exact support ``max <z, x>`` over x in B ∩ K, (m,), and maximisers (m, n), for z (m, n)."""

    @cached_property
    def conic(self) -> tuple[FloatArray, list[FloatArray]]:
        """A (n, l) and matrices M (r, l) with ``K = {A u : every M u in a second-order cone}``."""
        return conic_lift(self.contacts, self.space)

    @property
    def lift(self) -> FloatArray:
        """Matrix A (n, l) from variables in the contacts' cones to forces: the identity, but for corners of pads."""
        return self.conic[0]

    @cached_property
    def is_lifted(self) -> bool:
        """Whether the variables are not the force components themselves."""
        return is_lifted(self.lift)

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support (m,), and variables (m, l) in the contacts' cones of maximisers A u, for z (m, n)."""
        value, x = self.support(z)
        return value, project_lifted(x, self.contacts, self.space) if self.is_lifted else x

    @property
    def edges(self) -> FloatArray | None:
        """Edges of the set in the plane, (m, n), where it is a polytope; None where it is not."""
        return None

    @abstractmethod
    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the least factors f, (m,), such that forces x of K, (m, n), are in ``f B``."""

    @abstractmethod
    def cones(self) -> list[FloatArray]:
        """Return matrices M (r, n + 1) such that x is in ``f B`` if each ``M (x, f)`` is in a second-order cone.

        For a matrix of one row, that cone is the nonnegative numbers.
        """


class ForceBudget(ABC):
    """Force budget: a convex set B that bounds the finger forces (docs/measures.md).

    The grasp wrench set is ``G(B ∩ K)``; ``at`` returns ``B ∩ K`` for given contact frames. Each budget has a ``kind``,
    its name in files, and is registered in ``nlpgrasp.budgets.registry``.
    """

    kind: ClassVar[str]
    depends_on_frames: ClassVar[bool] = False
    follows_hand: ClassVar[bool] = False  # whether it depends on the hand's posture
    limited: ClassVar[str] = ""  # the limited quantity, if it does not bound bilateral contacts
    by_name: ClassVar[bool] = True  # whether its name is enough, with default parameters
    absolute: ClassVar[bool] = False  # whether it is the hand's full capability, not a unit of force
    amount: ClassVar[str] = "the force budget"  # text for the quantity ``1 / mu``
    unit: ClassVar[str] = "N"  # unit of that quantity
    bounds_fingers: ClassVar[bool] = False  # whether it bounds the norm of each finger's force
    largest: ClassVar[float] = 50.0  # bound on the program's force variables, in units of ``force_scale``

    def check(self, contacts: Sequence[ContactModel], space: int) -> None:
        """Raise ``InputError`` if the budget does not fit the contacts, or does not bound their forces."""
        if self.limited and not all(c.unilateral for c in contacts):
            raise InputError("force_budget", self.limited, '"l2" with bilateral contacts')

    @abstractmethod
    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> ForceSet:
        """Return the force set ``B ∩ K`` for given contact frames.

        Parameters
        ----------
        frames : (k, space, space) array
            Axes as columns, normal first.
        contacts : sequence of k ContactModel
            Accepted by ``check``.

        Raises
        ------
        InputError
            When the forces are unbounded, or depend on a hand's posture.
        """

    def check_hand(self, hand: JointedHand | None) -> None:
        """Raise ``InputError`` if a hand lacks the data for this budget."""
        del hand

    def posed(
        self, hand: HandWithJacobians | None, values: Mapping[str, FloatArray], points: FloatArray
    ) -> ForceBudget:
        """Return the budget for a posture of the hand and contact points (k, space)."""
        return self

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops
    ) -> tuple[Expression, int] | None:
        """Return a smooth closed form of the support function or of its square, and its degree 1 or 2; or ``None``.

        Parameters
        ----------
        contacts : sequence of k ContactModel
        work : sequence of k Work
            Of each contact.
        ops : module
            ``numpy`` or ``casadi``.

        Returns
        -------
        expression, degree
            ``phi`` itself, degree 1, or its square, degree 2.
        """
        return None

    @property
    def has_kinks(self) -> bool:
        """Whether supports have kinks at most weakest directions, so that forces there decide how mu changes.

        Not said of budgets that depend on the contacts' frames, whose prices change as well.
        """
        return not self.depends_on_frames

    def force_scale(self) -> float:
        """Return a typical force within the budget, newtons, as the NLP's unit of force."""
        return 1.0

    @abstractmethod
    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the scalar constraints that the budget puts on the NLP's force variables (symbolic)."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ForceBudget) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(str(self.to_dict()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def to_dict(self) -> str | Json:
        """Return the budget as JSON data: its ``kind``, or a mapping with ``type`` and parameters."""
        return self.kind

    @classmethod
    def from_dict(cls, data: Json) -> ForceBudget:
        """Return the budget that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When a number is missing or out of range, or the budget has no parameters.
        """
        raise InputError("force_budget", str(data), f'"{cls.kind}", its name alone')
