"""Contacts with less friction."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

from nlpgrasp.contacts.base import ContactModel


def less_friction(models: Sequence[ContactModel], share: float) -> tuple[ContactModel, ...]:
    """Return the contacts with this share less friction and torsional friction."""
    result = []
    for model in models:
        weaker = copy(model)
        for name in ("friction", "torsional_friction"):
            value = getattr(model, name, None)
            if isinstance(value, float):
                object.__setattr__(weaker, name, (1.0 - share) * value)
        result.append(weaker)
    return tuple(result)
