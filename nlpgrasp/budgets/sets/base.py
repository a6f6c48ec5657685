"""What every set of forces states about itself: a budget bound to contacts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import ranges


class ForceSet(ABC):
    """``B n K``: the forces that contacts may exert with one unit of a force budget, (2.5-2).

    Forces are stacked as in G: n components, contact by contact, each in its frame, normal force first.

    Parameters
    ----------
    contacts : sequence of k ContactModel
        Whose force domains make K.
    space : int
        Dimension of the contacts' points: 2 or 3.
    """

    power: ClassVar[float] = 2.0  # p, where the support is near the p-norm of the contacts' own supports

    def __init__(self, contacts: Sequence[ContactModel], space: int) -> None:
        self.contacts, self.space = tuple(contacts), space
        self.ranges = ranges(self.contacts, space)

    @property
    def size(self) -> int:
        """Number n of force components."""
        return sum(c.components(self.space) for c in self.contacts)

    @property
    def costly(self) -> bool:
        """Whether a support is a conic program: too slow for the many thousand that nu needs."""
        return False

    @abstractmethod
    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``max <z, x>`` over x in B n K, exactly, and a force that attains it: (m, n) to (m,) and (m, n)."""

    @abstractmethod
    def used(self, x: FloatArray) -> FloatArray:
        """Return the least factor f with x in f B, for forces of K: (m, n) to (m,)."""

    @abstractmethod
    def cones(self) -> list[FloatArray]:
        """Return matrices M: x is in f B where every ``M (x, f)`` is in a second-order cone (one row: at least 0)."""
