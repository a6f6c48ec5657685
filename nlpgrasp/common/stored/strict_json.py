"""Strict JSON parsing with finite numbers and schema validation."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NoReturn

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    import jsonschema


def read_object(text: str, name: str) -> Json:
    """Parse a JSON text that must be an object.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for messages.

    Raises
    ------
    InputError
        When the text is invalid or truncated JSON, contains NaN, infinity or too long numbers, or is no object.
    """
    try:
        data = json.loads(text, parse_constant=_refuse_constant, parse_int=_bounded_int)
    except json.JSONDecodeError as error:
        raise InputError(name, f"not valid JSON at line {error.lineno}: {error.msg}", "a complete JSON file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(name, str(error), "a JSON file with finite numbers") from None
    if not isinstance(data, dict):
        raise InputError(name, type(data).__name__, "a JSON object")
    return data


def check_schema(data: Json, validator: jsonschema.Draft202012Validator, name: str, expected: str) -> None:
    """Raise for data with numbers too large for a float, or that violate a schema, naming the first such field.

    Parameters
    ----------
    data : dict
    validator : jsonschema validator
    name : str
        Of the file, for messages.
    expected : str
        Reference to what is allowed, for messages.
    """
    try:
        _refuse_infinite(data, name)
        errors = sorted(validator.iter_errors(data), key=lambda e: list(map(str, e.absolute_path)))
    except RecursionError:
        raise InputError(name, "nesting without end", expected) from None
    if errors:
        where = ".".join(str(part) for part in errors[0].absolute_path) or "top level"
        raise InputError(f"{name}: {where}", errors[0].message, expected)


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a number in JSON")


def _bounded_int(text: str) -> int:
    if len(text) > 18:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _refuse_infinite(value: object, name: str, where: str = "") -> None:
    """Raise for numbers too large for a float, which JSON parses as infinity."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{name}: {where or 'top level'}", "a number too large for a float", "finite numbers")
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_infinite(item, name, f"{where}.{key}".lstrip("."))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            _refuse_infinite(item, name, f"{where}.{index}".lstrip("."))
