"""Registry of force budgets by name, for users and JSON files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.hand_torques import HandTorques
from nlpgrasp.budgets.joint_torques import JointTorqueLimits
from nlpgrasp.budgets.l2 import L2Budget
from nlpgrasp.budgets.per_finger import PerFingerBudget
from nlpgrasp.budgets.per_finger_size import PerFingerSizeBudget
from nlpgrasp.budgets.shared import SharedBudget
from nlpgrasp.budgets.shared_joint_torques import SharedJointTorqueLimits
from nlpgrasp.common.registry import Registry
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError

Kind = TypeVar("Kind", bound=ForceBudget)

BUDGETS: Registry[ForceBudget] = Registry("force_budget")
NAMED: dict[str, ForceBudget] = {}  # budgets that their name alone defines


def register(budget: type[Kind]) -> type[Kind]:
    """Register a force budget; also usable as a decorator.

    Parameters
    ----------
    budget : subclass of ForceBudget
        Its ``kind`` is its name, or the ``type`` in its ``to_dict``; with parameters it needs ``from_dict``.

    Raises
    ------
    InputError
        When another budget has that name.
    """
    BUDGETS.add(budget.kind, budget)
    if budget.by_name:
        NAMED[budget.kind] = budget()
    return budget


def force_budget(value: str | ForceBudget, field: str = "force_budget") -> ForceBudget:
    """Return the force budget with a given name; a budget is returned unchanged.

    Raises
    ------
    InputError
        When the name is not registered.
    """
    if isinstance(value, ForceBudget):
        return value
    if isinstance(value, str) and value in NAMED:
        return NAMED[value]
    raise InputError(field, value, "one of " + ", ".join(NAMED) + ", or ng.JointTorqueLimits(...)")


def frame_independent_names() -> list[str]:
    """Return the names of budgets that do not depend on contact frames."""
    return [name for name, budget in NAMED.items() if not budget.depends_on_frames]


def budget_from_dict(data: str | Json, field: str = "force_budget") -> ForceBudget:
    """Return a force budget of any registered type from its JSON data."""
    kind = BUDGETS.find(data.get("type")) if isinstance(data, Mapping) else None
    if kind is not None and isinstance(data, Mapping):
        return kind.from_dict(data)
    return force_budget(data if isinstance(data, str) else str(data), field)


register(L2Budget)
register(PerFingerBudget)
register(SharedBudget)
register(PerFingerSizeBudget)
register(HandTorques)
register(JointTorqueLimits)
register(SharedJointTorqueLimits)
