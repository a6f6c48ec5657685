"""Base class of force sets ``B n K`` of given contacts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import ranges


class ForceSet(ABC):
    """Force set ``B n K``: admissible contact forces within one unit of a budget, (2.5-2).

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
        self.ranges = ranges(self.contacts, space)

    @property
    def size(self) -> int:
        """Number n of force components."""
        return sum(c.components(self.space) for c in self.contacts)

    @property
    def costly(self) -> bool:
        """Whether a support evaluation solves a conic program, too slow for the many thousand that nu needs."""
        return False

    @abstractmethod
    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the exact support ``max <z, x>`` over x in B n K, (m,), and maximisers (m, n), for z (m, n)."""

    @abstractmethod
    def used(self, x: FloatArray) -> FloatArray:
        """Return the gauge of B, the least f with x in f B, (m,), for forces x of K (m, n)."""

    @abstractmethod
    def cones(self) -> list[FloatArray]:
        """Return matrices M: x is in f B if every ``M (x, f)`` is in a second-order cone (one row: nonnegative)."""
