"""The kinds of a room by their names in a file: how a kind from elsewhere joins them."""

from __future__ import annotations

from typing import Generic, TypeVar

from nlpgrasp.errors import InputError

Kind = TypeVar("Kind")


class Registry(Generic[Kind]):
    """Classes by the name that stands for them in JSON, in the order in which they were added.

    Parameters
    ----------
    field : str
        Where a name stands, for messages: ``"contact.model"``.
    """

    def __init__(self, field: str) -> None:
        self._field = field
        self._kinds: dict[str, type[Kind]] = {}

    def add(self, name: str, kind: type[Kind]) -> None:
        """Add a class.

        Raises
        ------
        InputError
            On a name that is empty, or another class's.
        """
        if not isinstance(name, str) or not name:
            raise InputError(f"{kind.__name__}.kind", name, "the name that stands for it in a file")
        taken = self._kinds.get(name)
        if taken is not None and (taken.__module__, taken.__qualname__) != (kind.__module__, kind.__qualname__):
            raise InputError(f"{kind.__name__}.kind", name, f"another name: that one is {taken.__name__}'s")
        self._kinds[name] = kind

    def find(self, name: object) -> type[Kind] | None:
        """Return the class of a name, ``None`` where there is none."""
        return self._kinds.get(name) if isinstance(name, str) else None

    def unknown(self, name: object, more: str = "") -> InputError:
        """Return the error that lists the known names, and perhaps ``more`` that is allowed."""
        return InputError(self._field, name, "one of " + ", ".join([*self._kinds]) + more)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all kinds."""
        return tuple(self._kinds)
