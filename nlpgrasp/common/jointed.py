"""What force budgets know of a hand: joints, what they can hold, and how they move the contacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray


class JointedHand(Protocol):
    """A hand that says which of its joints move its contacts; every hand of ``nlpgrasp.hands`` does."""

    @property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the joints that move some contact; none of a hand without joints."""

    @property
    def torque_limits(self) -> Mapping[str, float]:
        """Largest torques by joint, newton-metres (newtons for sliding joints)."""


class MovingHand(JointedHand, Protocol):
    """A jointed hand that says how its contacts move in a posture; every ``nlpgrasp.hands.PosedHand`` does."""

    @property
    def count(self) -> int:
        """Number of the hand's fingertips."""

    def contact_jacobians(self, values: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Return velocity and angular velocity per rate of the loaded joints, (k, 6, m), of points (k, 3)."""

    def values_of(self, posture: Json) -> dict[str, FloatArray]:
        """Return values of the hand's variables, by name, in a posture as ``GraspSolution.hand`` holds it."""
