"""Registries of classes by their names in JSON data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import TYPE_CHECKING, ClassVar, Generic, Protocol, Self, TypeVar, runtime_checkable

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError

if TYPE_CHECKING:  # certificates reach common, and no CasADi
    import casadi as ca


Kind = TypeVar("Kind")


class FromJson(Protocol):
    """Protocol of classes that are constructed from JSON data."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the object from the data of its ``to_dict``."""


class JsonPart(ABC):
    """Base class of problem parts that are stored in files by kind and parameters.

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    """

    kind: ClassVar[str]

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the part as JSON data: ``kind`` as ``type``, and its parameters."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the part from the data of its ``to_dict``; a dataclass by its fields.

        Raises
        ------
        InputError
            When the data are incomplete.
        """
        return from_fields(cls, data)


StatedKind = TypeVar("StatedKind", bound=FromJson)


class Registry(Generic[Kind]):
    """Registry of classes by their names in JSON data, in order of registration.

    Parameters
    ----------
    field : str
        Field of the name, for messages: ``"contact.model"``.
    """

    def __init__(self, field: str) -> None:
        self._field = field
        self._kinds: dict[str, type[Kind]] = {}

    def add(self, name: str, kind: type[Kind]) -> None:
        """Register a class under a name.

        Raises
        ------
        InputError
            On an empty name, or one of another class.
        """
        if not isinstance(name, str) or not name:
            raise InputError(f"{kind.__name__}.kind", name, "the name that stands for it in a file")
        registered = self._kinds.get(name)
        if registered is not None and (registered.__module__, registered.__qualname__) != (
            kind.__module__,
            kind.__qualname__,
        ):
            raise InputError(f"{kind.__name__}.kind", name, f"another name: that one is {registered.__name__}'s")
        self._kinds[name] = kind

    def find(self, name: object) -> type[Kind] | None:
        """Return the class with a given name, or ``None``."""
        return self._kinds.get(name) if isinstance(name, str) else None

    def unknown(self, name: object, addition: str = "") -> InputError:
        """Return the error for an unknown name, which lists the known names."""
        return InputError(self._field, name, "one of " + ", ".join([*self._kinds]) + addition)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all registered classes, in order of registration."""
        return tuple(self._kinds)


def from_registered(registry: Registry[StatedKind], part: str, data: object) -> StatedKind:
    """Return the object of JSON data, of the registered class that the entry ``type`` names.

    Parameters
    ----------
    registry : Registry
    part : str
        For messages: ``"body"``.
    data : mapping

    Raises
    ------
    InputError
        When the type is unknown or the data are invalid.
    """
    name = data.get("type") if isinstance(data, Mapping) else data
    kind = registry.find(name)
    if kind is None or not isinstance(data, Mapping):
        raise registry.unknown(name)
    try:
        return kind.from_dict(data)
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{part} of type {name}", f"{type(error).__name__}: {error}", "what its to_dict says"
        ) from None


def from_fields(kind: type[Kind], data: Json) -> Kind:
    """Return a dataclass instance whose fields are the entries of JSON data with the same names.

    Raises
    ------
    KeyError
        When the entry of a field without default is missing.
    InputError
        When the class is not a dataclass.
    """
    if not is_dataclass(kind):
        raise incomplete_data(kind.__name__, "a from_dict of its own")
    required = [f.name for f in fields(kind) if f.init and f.default is MISSING and f.default_factory is MISSING]
    values = {f.name: data[f.name] for f in fields(kind) if f.init and (f.name in data or f.name in required)}
    return kind(**values)


def incomplete_data(part: str, missing: str) -> InputError:
    """Return the error for JSON data that lack what is needed to construct an object."""
    return InputError(part, "JSON data alone", missing)


@runtime_checkable
class SolidBody(Protocol):
    """Protocol of bodies as constraints use them, with dimension and signed distance."""

    @property
    def space(self) -> int:
        """Dimension of space: 2 or 3."""

    @property
    def distance_function(self) -> ca.Function:
        """Signed distance of a point, metres, as a compiled ``casadi.Function``."""

    def to_dict(self) -> Json:
        """Return the body as JSON data."""


class JsonSolid(SolidBody, Protocol):
    """Protocol of bodies that can be stored in files."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the body from the data of its ``to_dict``."""


SOLIDS: Registry[JsonSolid] = Registry("body.type")  # filled by nlpgrasp.bodies


def solid_from_dict(data: object) -> SolidBody:
    """Return a body of any registered type from its JSON data.

    Raises
    ------
    InputError
        When the type is unknown, or the data are invalid or incomplete.
    """
    return from_registered(SOLIDS, "body", data)
