"""Shared type aliases and protocols."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias

from nlpgrasp.common.validation import FloatArray

Expression: TypeAlias = Any
"""A CasADi expression, column or scalar: ``SX`` in the program, ``MX`` where a mesh's spline takes part, ``DM`` with
numbers in place of symbols. Constraints, hands and bodies are written once for all three, which share operators but no
base class that says so; what is of one kind alone is typed as that kind."""


class Ops(Protocol):
    """Protocol of functions that ``numpy`` and ``casadi`` have in common, for numbers and expressions."""

    def fmax(self, a: Expression, b: Expression, /) -> Expression:
        """Return the larger of two values."""

    def fmin(self, a: Expression, b: Expression, /) -> Expression:
        """Return the smaller of two values."""

    def sqrt(self, a: Expression, /) -> Expression:
        """Return the square root of a value."""


Json: TypeAlias = Mapping[str, Any]
"""A JSON object: what ``to_dict`` writes and ``from_dict`` reads. Files are checked against the schema when they are
read, so that its entries need no further types."""


class JointedHand(Protocol):
    """Protocol of hands as force budgets use them: joints that move contacts, and torque limits.

    All of ``nlpgrasp.hands`` satisfy it.
    """

    @property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the joints that move some contact; empty for a hand without joints."""

    @property
    def closed_linkages(self) -> tuple[str, ...]:
        """Names of the equations that the joints keep, where joints form loops."""

    @property
    def torque_limits(self) -> Mapping[str, float]:
        """Largest torques by joint, newton-metres (newtons for sliding joints)."""


class HandWithJacobians(JointedHand, Protocol):
    """Protocol of jointed hands with contact Jacobians.

    Every ``nlpgrasp.hands.PosedHand`` satisfies it.
    """

    @property
    def count(self) -> int:
        """Number of fingertips."""

    def contact_jacobians(self, values: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Return the contact Jacobians (k, 6, m) of points (k, 3) with respect to the loaded joints."""

    def values_of(self, posture: Json) -> dict[str, FloatArray]:
        """Return the hand's variables by name, given a posture as in ``GraspSolution.hand``."""
