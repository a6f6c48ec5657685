"""Protocols of hands with joints, for force budgets: torque limits and contact Jacobians."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray


class JointedHand(Protocol):
    """Protocol of hands with the joints that move their contacts; all of ``nlpgrasp.hands`` satisfy it."""

    @property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the joints that move some contact; empty without joints."""

    @property
    def torque_limits(self) -> Mapping[str, float]:
        """Largest torques by joint, newton-metres (newtons for sliding joints)."""


class MovingHand(JointedHand, Protocol):
    """Protocol of jointed hands with contact Jacobians; every ``nlpgrasp.hands.PosedHand`` satisfies it."""

    @property
    def count(self) -> int:
        """Number of fingertips."""

    def contact_jacobians(self, values: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Return the contact Jacobians (k, 6, m) of points (k, 3) with respect to the loaded joints."""

    def values_of(self, posture: Json) -> dict[str, FloatArray]:
        """Return the hand's variables by name, from a posture as in ``GraspSolution.hand``."""
