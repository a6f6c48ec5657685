"""Budgets of which nothing can be said before it is known where the contacts, or the hand, are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NoReturn

from nlpgrasp.budgets.base import ForceBudget, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError


class UnplacedBudget(ForceBudget):
    """Limits on joint torques: how forces load the joints depends on the contacts' frames."""

    depends_on_frames: ClassVar[bool] = True
    limited: ClassVar[str] = "joint-torque limits"
    without: ClassVar[str] = "joint-torque limits without contact frames"  # what was given, for messages
    instead: ClassVar[str] = "the budget of `at(frames)`"

    def support(self, z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
        """Refuse."""
        self._refuse()

    def used(self, x: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
        """Refuse."""
        self._refuse()

    def cones(self, contacts: Sequence[ContactModel], space: int) -> list[FloatArray]:
        """Refuse."""
        self._refuse()

    def rows(self, contacts: Sequence[ContactModel], forces: Sequence[Any], normals: Sequence[Any]) -> list[Row]:
        """Refuse."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise InputError("force_budget", self.without, self.instead)
