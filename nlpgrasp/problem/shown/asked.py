"""What is told of a problem: its parts, as ``GraspProblem`` has them."""

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
    """The parts of a ``GraspProblem`` that words need: it stands above them and is not imported here."""

    @property
    def name(self) -> str:
        """Shown in prints."""

    @property
    def body(self) -> Body:
        """What is held, in its own frame."""

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """Contact models, one a contact."""

    @property
    def task(self) -> Task:
        """What the fingers are to exert, about ``origin``."""

    @property
    def hand(self) -> Hand | None:
        """What holds it; None where each contact may be anywhere."""

    @property
    def constraints(self) -> Sequence[PlacementConstraint]:
        """Where contacts and hand may be."""

    @property
    def budget(self) -> ForceBudget:
        """What a unit of finger force means."""

    @property
    def margin(self) -> float:
        """How far contacts stay away from edges, metres."""

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres."""

    @property
    def torque_origin(self) -> ArrayLike | None:
        """The torque origin where one was given."""

    @property
    def max_force(self) -> float | None:
        """Limit of each finger's force, newtons."""

    def allowed_faces(self, contact: int) -> tuple[str, ...]:
        """Return names of the faces a contact may use."""
