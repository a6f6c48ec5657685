"""Base class of records in solution files: JSON data and JSON Schema from the fields of a dataclass."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, fields
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Self, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.quality.bounds import Bounds

# metadata of fields; "key" names an entry that is not called as its field
LATER: Json = {"optional": True}  # missing in files of earlier versions
LEFT_OUT: Json = {"optional": True, "left_out": True}  # not written where it is the default
NULL_IF_INFINITE: Json = {"null": True}  # null, which is read as the default

TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}  # their names in a JSON Schema
MOST = 10_000  # entries of a list
RESOLVED: dict[type, dict[str, Any]] = {}  # types of the fields, by class


class Form:
    """Annotation of a field's type with its form in JSON: number of array axes, keywords of the JSON Schema.

    Parameters
    ----------
    axes : int
        Number of axes of an array; 0 for other types.
    ref : str
        Name of the definition in the JSON Schema, if there is one.
    **keywords
        Keywords of the JSON Schema, beside those of the type.
    """

    def __init__(self, axes: int = 0, ref: str = "", **keywords: object) -> None:
        self.axes, self.ref, self.keywords = axes, ref, keywords


NonNegative: TypeAlias = Annotated[float, Form(minimum=0)]
Share: TypeAlias = Annotated[float, Form(minimum=0, maximum=1)]
Count: TypeAlias = Annotated[int, Form(minimum=0)]
Direction: TypeAlias = Annotated[tuple[float, ...], Form(ref="wrench")]
Wrench: TypeAlias = Annotated[FloatArray, Form(1, ref="wrench")]
Points: TypeAlias = Annotated[FloatArray, Form(2, ref="points")]
Vector: TypeAlias = Annotated[FloatArray, Form(1)]
Matrix: TypeAlias = Annotated[FloatArray, Form(2)]


@dataclass(frozen=True)
class Record:
    """Base class of dataclasses that are stored as JSON objects, with one entry for each field.

    Enumerations are stored as names in lower case. A computed field (``init=False``) is written, not read.
    """

    def to_dict(self) -> Json:
        """Return the record as JSON data."""
        data = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if "left_out" in field.metadata and type(value) is type(field.default) and value == field.default:
                continue
            is_null = "null" in field.metadata and not math.isfinite(getattr(value, "upper", value))
            data[_key(field)] = None if is_null else to_json(value)
        return data

    @classmethod
    def from_dict(cls, data: Json, name: str = "") -> Self:
        """Return the record that ``to_dict`` wrote.

        ``name`` is shown in messages.

        Raises
        ------
        InputError
            On an invalid array, or an empty interval. Other invalid data are refused by the schema of files.
        """
        types, values = _types(cls), {}
        for field in fields(cls):
            key = _key(field)
            if not field.init or ("optional" in field.metadata and data.get(key) is None):
                continue
            if data[key] is not None or "null" not in field.metadata:
                values[field.name] = _read(types[field.name], data[key], f"{name}.{key}".lstrip("."))
        return cls(**values)

    @classmethod
    def json_schema(cls) -> Json:
        """Return the JSON Schema of ``to_dict``, with descriptions from the docstring of the class."""
        text = (inspect.getdoc(cls) or "").replace("``", "")
        parameters = re.findall(r"^(\w+(?:, \w+)*) : .*\n((?:    .*\n?)+)", text, re.MULTILINE)
        descriptions = {name: " ".join(lines.split()) for names, lines in parameters for name in names.split(", ")}
        properties = {}
        for field in fields(cls):
            described = {"description": descriptions[field.name]} if field.name in descriptions else {}
            properties[_key(field)] = {**_field_schema(field, _types(cls)[field.name]), **described}
        required = [_key(field) for field in fields(cls) if "optional" not in field.metadata]
        return {"type": "object", "required": required, "description": text.split("\n")[0], "properties": properties}


def to_json(value: object) -> Any:
    """Return a record's value as JSON data: arrays and tuples as lists, records as objects."""
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [to_json(item) for item in value]
    if isinstance(value, Mapping):
        return {name: to_json(item) for name, item in value.items()}
    return value.to_dict() if hasattr(value, "to_dict") else value


def _read(kind: Any, data: Any, name: str) -> Any:
    """Return the value of a given type that ``to_json`` wrote."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if data is None else _read(arguments[0], data, name)
    if origin is Annotated:
        axes = arguments[1].axes
        return array(name, data, (None,) * axes) if axes else _read(arguments[0], data, name)
    if origin is tuple:
        return tuple(_read(arguments[0], item, f"{name}.{i}") for i, item in enumerate(data))
    if origin is Mapping:
        return {str(key): _read(arguments[1], item, f"{name}.{key}") for key, item in data.items()}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[data.upper()]
    if hasattr(kind, "from_dict"):
        return kind.from_dict(data, name)
    return kind(data)


def _schema(kind: Any) -> Json:
    """Return the JSON Schema of the values of a type."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return nullable(_schema(arguments[0]))
    if origin is Annotated:
        form: Form = arguments[1]
        if form.ref or "enum" in form.keywords:
            return {"$ref": f"#/$defs/{form.ref}"} if form.ref else form.keywords
        return {**(_array_schema(form.axes) if form.axes else _schema(arguments[0])), **form.keywords}
    if origin is tuple:
        return {"type": "array", "maxItems": MOST, "items": _schema(arguments[0])}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": _schema(arguments[1])}
    if issubclass(kind, Enum):
        return {"enum": [member.name.lower() for member in kind]}
    if issubclass(kind, Record):
        schema: Json = kind.json_schema()
        return schema
    if kind is Bounds:
        limits = dict.fromkeys(("lower", "upper"), _schema(NonNegative))
        return {"type": "object", "required": list(limits), "properties": limits}
    return {"type": TYPES[kind]}


def _array_schema(axes: int) -> Json:
    """Return the JSON Schema of an array of numbers."""
    return {"type": "array", "items": _array_schema(axes - 1)} if axes else {"type": "number"}


def nullable(schema: Json) -> Json:
    """Return the JSON Schema that also allows null."""
    if "type" in schema:
        return {**schema, "type": [schema["type"], "null"]}
    return {"oneOf": [schema, {"type": "null"}]}


def _field_schema(field: Field[Any], kind: Any) -> Json:
    """Return the JSON Schema of a field's entry.

    Null is not allowed if a default of None is not written.
    """
    if "null" in field.metadata:
        return nullable(_schema(kind))
    return _schema(get_args(kind)[0] if "left_out" in field.metadata and NoneType in get_args(kind) else kind)


def _key(field: Field[Any]) -> str:
    """Return the name of a field's entry in the JSON object."""
    return str(field.metadata.get("key", field.name))


def _types(cls: type[Record]) -> dict[str, Any]:
    """Return the types of a class's fields, cached by class."""
    if cls not in RESOLVED:
        RESOLVED[cls] = get_type_hints(cls, include_extras=True)
    return RESOLVED[cls]
