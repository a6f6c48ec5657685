"""Force budgets from their names and from JSON data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.hand_torques import HandTorques
from nlpgrasp.budgets.joint_torques import JointTorqueLimits
from nlpgrasp.budgets.l2 import L2Budget
from nlpgrasp.budgets.per_finger import PerFingerBudget
from nlpgrasp.budgets.per_finger_size import PerFingerSizeBudget
from nlpgrasp.budgets.shared import SharedBudget
from nlpgrasp.budgets.shared_joint_torques import SharedJointTorqueLimits
from nlpgrasp.errors import InputError

NAMED: dict[str, ForceBudget] = {
    b.kind: b for b in (L2Budget(), PerFingerBudget(), SharedBudget(), PerFingerSizeBudget(), HandTorques())
}


def force_budget(value: str | ForceBudget, field: str = "force_budget") -> ForceBudget:
    """Return the budget of a name, or the budget itself.

    Raises
    ------
    InputError
        When the name is none of the known ones.
    """
    if isinstance(value, ForceBudget):
        return value
    if isinstance(value, str) and value in NAMED:
        return NAMED[value]
    raise InputError(field, value, "one of " + ", ".join(NAMED) + ", or ng.JointTorqueLimits(...)")


def budget_from_dict(data: str | Mapping[str, Any], field: str = "force_budget") -> ForceBudget:
    """Return the budget that ``to_dict`` wrote."""
    if isinstance(data, Mapping) and data.get("type") == JointTorqueLimits.kind:
        return JointTorqueLimits(data.get("jacobians", ()), data.get("limits", ()))
    if isinstance(data, Mapping) and data.get("type") == SharedJointTorqueLimits.kind:
        return SharedJointTorqueLimits(data.get("jacobians", ()), data.get("limits", ()), data.get("force_limit"))
    if isinstance(data, Mapping) and data.get("type") == HandTorques.kind:
        return HandTorques(data.get("force_limit", 0.0))
    return force_budget(data if isinstance(data, str) else str(data), field)
