"""Copies of frozen objects with other fields, as they stand."""

from __future__ import annotations

from copy import copy
from typing import TypeVar

Item = TypeVar("Item")


def unchecked(item: Item, **fields: object) -> Item:
    """Return a frozen object with other values of some fields, without its checks.

    For derivatives by differences, which step past what a field allows (a clearance of 0, less a little), and for parts
    that were checked before. Everywhere else ``dataclasses.replace`` is right: it checks.

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
