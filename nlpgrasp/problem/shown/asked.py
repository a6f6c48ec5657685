"""Read-only protocol of a grasp problem's parts, for its display."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from numpy.typing import ArrayLike

from nlpgrasp.bodies import Body
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import PlacementConstraint
from nlpgrasp.contacts import ContactModel
from nlpgrasp.hands import Hand
from nlpgrasp.tasks import Task


class Asked(Protocol):
    """Protocol of the parts of a ``GraspProblem`` that its display needs, without importing it."""

    @property
    def name(self) -> str:
        """Name for prints."""

    @property
    def body(self) -> Body:
        """Grasped body, in its own frame."""

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """Contact models, one per contact."""

    @property
    def task(self) -> Task:
        """Wrenches to exert, about ``origin``."""

    @property
    def hand(self) -> Hand | None:
        """Hand, or None for free contacts."""

    @property
    def constraints(self) -> Sequence[PlacementConstraint]:
        """Constraints on contacts and hand."""

    @property
    def budget(self) -> ForceBudget:
        """Force budget: the meaning of one unit of finger force."""

    @property
    def margin(self) -> float:
        """Least distance of contacts from sharp edges, metres."""

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres."""

    @property
    def torque_origin(self) -> ArrayLike | None:
        """Torque origin as given, or None."""

    @property
    def max_force(self) -> float | None:
        """Limit of each finger's force, newtons."""

    def allowed_faces(self, contact: int) -> tuple[str, ...]:
        """Return the names of a contact's allowed faces."""
