"""Force budget by the joint-torque limits of a hand, depending on its posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets.base import ForceBudget, ForceSet
from nlpgrasp.budgets.shared_joint_torques import SharedJointTorqueLimits
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.types import Expression, HandWithJacobians, JointedHand, Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError

MOST_FORCE = 100.0  # N, default limit of each normal force


class HandTorques(ForceBudget):
    """Joint-torque limits of the problem's hand: ``|sum_i J_i(q)^T f_i| <= tau`` in its posture q.

    mu is then the largest scale of the task within the torque limits. Where some force loads no joint (a straight
    finger, the palm), forces would be unbounded, hence the limit on normal force.

    Parameters
    ----------
    force_limit : float
        Largest normal force of a contact, newtons.
    """

    kind: ClassVar[str] = "hand_torques"
    follows_hand: ClassVar[bool] = True
    depends_on_frames: ClassVar[bool] = True
    absolute: ClassVar[bool] = True
    amount: ClassVar[str] = "share of the joints' torque limits"
    unit: ClassVar[str] = "of the torque limits"
    limited: ClassVar[str] = "joint-torque limits"

    def __init__(self, force_limit: float = MOST_FORCE) -> None:
        self.force_limit = number("HandTorques.force_limit", force_limit, above=0.0)

    def check_hand(self, hand: JointedHand | None) -> None:
        """Raise ``InputError`` for a hand without a limit for each joint that moves a contact, or with linkages."""
        if hand is None or not hand.loaded_joints:
            raise InputError("GraspProblem.force_budget", '"hand_torques"', "a hand with joints, such as ng.URDFHand")
        if hand.closed_linkages:
            given = f'"hand_torques" for a hand with closed linkages ({hand.closed_linkages[0]})'
            raise InputError("GraspProblem.force_budget", given, "another budget: ng.squeeze states its torques")
        missing = [name for name in hand.loaded_joints if name not in hand.torque_limits]
        if missing:
            expected = "one for each joint that moves a contact, where the URDF states no effort or 0"
            raise InputError("URDFHand.torque_limits", f"none for {', '.join(missing)}", expected)

    def posed(
        self, hand: HandWithJacobians | None, values: Mapping[str, FloatArray], points: FloatArray
    ) -> ForceBudget:
        """Return the ``SharedJointTorqueLimits`` of a posture."""
        self.check_hand(hand)
        return (
            self
            if hand is None
            else SharedJointTorqueLimits(*_jacobians_and_limits(hand, values, points), self.force_limit)
        )

    def force_scale(self) -> float:
        """Return a tenth of the largest normal force, newtons."""
        return 0.1 * self.force_limit

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> ForceSet:
        """Raise ``InputError``, as the force set depends on the hand's posture."""
        instead = "ng.hand_torque_limits(hand, posture, points)"
        raise InputError("force_budget", '"hand_torques" without a posture', instead)

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return an empty list, as the constraints depend on the posture.

        They are in ``nlp.virtual_work.joint_torque_constraints``.
        """
        return []

    def to_dict(self) -> Json:
        """Return the largest normal force as JSON data; the joint limits are data of the hand."""
        return {"type": self.kind, "force_limit": self.force_limit}

    @classmethod
    def from_dict(cls, data: Json) -> HandTorques:
        """Return the budget that ``to_dict`` wrote."""
        return cls(data.get("force_limit", 0.0))


def hand_torque_limits(
    hand: HandWithJacobians, posture: Json, points: ArrayLike, force_limit: float = MOST_FORCE
) -> SharedJointTorqueLimits:
    """Return the force budget of a hand's joint-torque limits in a posture.

    Parameters
    ----------
    hand : URDFHand
        With torque limits for every joint that moves a contact.
    posture : mapping
        ``joint_positions`` and ``palm_pose``, as in ``GraspSolution.hand``.
    points : (k, 3) array
        Contact points, metres, body frame; contact i is fixed to fingertip i's link.
    force_limit : float
        Largest normal force of a contact, newtons.

    Raises
    ------
    InputError
        When joints without a limit move a contact.
    """
    positions = array("points", points, (hand.count, 3))
    values = hand.values_of(posture)
    HandTorques(force_limit).check_hand(hand)
    return SharedJointTorqueLimits(*_jacobians_and_limits(hand, values, positions), force_limit)


def _jacobians_and_limits(
    hand: HandWithJacobians, values: Mapping[str, FloatArray], points: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Return the contact Jacobians of a hand in a posture, and its joint-torque limits."""
    limits = np.array([hand.torque_limits[name] for name in hand.loaded_joints])
    return list(hand.contact_jacobians(values, points)), limits
