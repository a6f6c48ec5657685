"""What every force budget states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.jointed import JointedHand, MovingHand
from nlpgrasp.common.rows import Row
from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.errors import InputError


class ForceBudget(ABC):
    """What one unit of finger force means: a convex set B of forces, as stated (docs/measures.md).

    The grasp wrench set is ``G(B n K)``; the set itself, of contacts in their places, is what ``at`` returns. A kind
    has a ``kind``, its name in files, and is registered (``nlpgrasp.budgets.registry``).
    """

    kind: ClassVar[str]
    depends_on_frames: ClassVar[bool] = False
    follows_hand: ClassVar[bool] = False  # whether it is known only with the posture of a hand
    limited: ClassVar[str] = ""  # what it limits, where that leaves bilateral contacts without a bound
    by_name: ClassVar[bool] = True  # whether its name alone states it, with the default of every parameter
    absolute: ClassVar[bool] = False  # whether it is all that the hand has, not a unit of it
    amount: ClassVar[str] = "the force budget"  # what ``1 / mu`` is, in words
    unit: ClassVar[str] = "N"  # of that amount
    bounds_fingers: ClassVar[bool] = False  # whether no finger's force is larger than that amount
    largest: ClassVar[float] = 50.0  # bound on the program's force variables, in units of ``force_scale``

    def check(self, contacts: Sequence[ContactModel], space: int) -> None:
        """Raise ``InputError`` on contacts whose forces this budget does not bound, or does not fit."""
        if self.limited and not all(c.unilateral for c in contacts):
            raise InputError("force_budget", self.limited, '"l2" with bilateral contacts')

    @abstractmethod
    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> ForceSet:
        """Return the forces that it allows contacts with these frames.

        Parameters
        ----------
        frames : (k, space, space) array
            Axes as columns, normal first.
        contacts : sequence of k ContactModel
            That ``check`` lets pass.

        Raises
        ------
        InputError
            When the forces are not bounded, or not known without the posture of a hand.
        """

    def check_hand(self, hand: JointedHand | None) -> None:
        """Raise ``InputError`` on hands of which this budget cannot say what they can exert."""
        del hand

    def posed(self, hand: MovingHand | None, values: Mapping[str, FloatArray], points: FloatArray) -> ForceBudget:
        """Return the budget for contacts at points (k, space) of a hand with these values of its variables."""
        return self

    def closed_form(
        self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops
    ) -> tuple[Expression, int] | None:
        """Return a smooth closed form of the support function (symbolic), or ``None`` where there is none.

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

    def pieces(self, contacts: Sequence[ContactModel], work: Sequence[Work], ops: Ops) -> list[Expression] | None:
        """Return smooth functions whose largest is the support (symbolic), one a contact, or ``None``.

        For supports with kinks; arguments as in ``closed_form``.
        """
        return None

    def force_scale(self) -> float:
        """Return the size of force the budget allows, newtons: the program's unit of force."""
        return 1.0

    @abstractmethod
    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[Row]:
        """Return the budget's rows on the program's force variables (symbolic)."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ForceBudget) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(str(self.to_dict()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def to_dict(self) -> str | Json:
        """Return the budget as JSON data: its ``kind`` alone, or as ``type`` beside its parameters."""
        return self.kind

    @classmethod
    def from_dict(cls, data: Json) -> ForceBudget:
        """Return the budget whose parameters ``to_dict`` wrote.

        Raises
        ------
        InputError
            When a number is missing or out of range, or the budget has no parameters.
        """
        raise InputError("force_budget", str(data), f'"{cls.kind}", its name alone')


SMOOTH = 1e-8  # under the root that rounds the kinks of a closed form
