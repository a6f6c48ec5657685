"""Copies of frozen dataclasses with changed fields, without validation."""

from __future__ import annotations

from copy import copy
from typing import TypeVar

Item = TypeVar("Item")


def unchecked(item: Item, **fields: object) -> Item:
    """Return a copy of a frozen object with changed fields, without validation.

    For finite differences, which may step beyond a field's limits, and for parts that were checked before. Otherwise
    use ``dataclasses.replace``, which validates.

    Parameters
    ----------
    item : object
        Of a frozen dataclass.
    **fields
        Their new values.
    """
    result = copy(item)
    for name, value in fields.items():
        object.__setattr__(result, name, value)
    return result
