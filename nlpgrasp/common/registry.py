"""The kinds of a room by their names in a file: how a kind from elsewhere joins them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError

Kind = TypeVar("Kind")


class Stated(Protocol):
    """What JSON data can be made of."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return what ``to_dict`` wrote."""


class StatedPart(ABC):
    """A part of a problem that says in a file what it is: by its kind, and by the numbers that define it.

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    """

    kind: ClassVar[str]

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the part as JSON data: ``kind`` as ``type``, and what defines it."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the part that ``to_dict`` wrote: of a dataclass, by its fields.

        Raises
        ------
        InputError
            When the data do not say all of it.
        """
        return from_fields(cls, data)


StatedKind = TypeVar("StatedKind", bound=Stated)


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
        """Add a class under a name.

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
        """Names of all kinds, in the order in which they were added."""
        return tuple(self._kinds)


def read(registry: Registry[StatedKind], what: str, data: object) -> StatedKind:
    """Return what the class that data name in ``type`` makes of them.

    Parameters
    ----------
    registry : Registry
    what : str
        For messages: ``"body"``.
    data : mapping

    Raises
    ------
    InputError
        When the type is unknown, or its class makes nothing of the data.
    """
    name = data.get("type") if isinstance(data, Mapping) else data
    kind = registry.find(name)
    if kind is None or not isinstance(data, Mapping):
        raise registry.unknown(name)
    try:
        return kind.from_dict(data)
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{what} of type {name}", f"{type(error).__name__}: {error}", "what its to_dict says"
        ) from None


def from_fields(kind: type[Kind], data: Json) -> Kind:
    """Return a dataclass made of the entries of JSON data that its fields are called by.

    Raises
    ------
    KeyError
        When an entry is missing whose field has no default.
    InputError
        When the class is not a dataclass.
    """
    if not is_dataclass(kind):
        raise incomplete(kind.__name__, "a from_dict of its own")
    needed = [f.name for f in fields(kind) if f.init and f.default is MISSING and f.default_factory is MISSING]
    given = {f.name: data[f.name] for f in fields(kind) if f.init and (f.name in data or f.name in needed)}
    return kind(**given)


def incomplete(what: str, lacking: str) -> InputError:
    """Return the error that says what JSON data lack, of a kind that cannot be made of them."""
    return InputError(what, "JSON data alone", lacking)
