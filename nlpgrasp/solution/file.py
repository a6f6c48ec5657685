"""Solution files: written atomically, read without executing anything, every way to be wrong named."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn, cast

import jsonschema

from nlpgrasp.common.files import write_text
from nlpgrasp.errors import InputError
from nlpgrasp.solution.schema import SCHEMA_NAME, solution_schema
from nlpgrasp.solution.schema.kinds import EXPECTED, check_kinds
from nlpgrasp.solution.schema.types import SolutionData

LARGEST_FILE = 64 * 1024 * 1024
DEEPEST = 50


def write(data: SolutionData, path: str | Path) -> Path:
    """Write a solution's data to ``path``: either the whole file is there afterwards or the old one is.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written.
    """
    return write_text(path, text_of(data))


def text_of(data: SolutionData) -> str:
    """Return a solution's data as JSON text: indented for reading, but for the drawing, last and in one line."""
    drawing = json.dumps(data.get("drawing"), separators=(",", ":"), allow_nan=False)
    rest = json.dumps({k: v for k, v in data.items() if k != "drawing"}, indent=1, allow_nan=False)
    return f'{rest[:-2]},\n "drawing": {drawing}\n}}\n'


def read(path: str | Path) -> SolutionData:
    """Return the validated data of a solution file; every way a file can be wrong is an ``InputError``."""
    file = Path(path)
    try:
        size = file.stat().st_size
        if not file.is_file():
            raise InputError(str(path), "not a regular file", "a solution file")
        if size > LARGEST_FILE:
            raise InputError(str(path), f"{size / 2**20:.0f} MiB", f"at most {LARGEST_FILE // 2**20} MiB")
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(str(path), error.strerror or "unreadable", "a solution file that exists") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "bytes that are not UTF-8", "a JSON text file") from None
    return parse(text, str(path))


def parse(text: str, name: str) -> SolutionData:
    """Return the validated data of a JSON text; ``name`` is shown in messages."""
    if depth(text) > DEEPEST:
        raise InputError(name, f"nesting deeper than {DEEPEST}", "a solution file (schema 1)")
    try:
        data = json.loads(text, parse_constant=_refuse_constant, parse_int=_bounded_int)
    except json.JSONDecodeError as error:
        raise InputError(name, f"not valid JSON at line {error.lineno}: {error.msg}", "a complete JSON file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(name, str(error), "a JSON file with finite numbers") from None
    if not isinstance(data, dict):
        raise InputError(name, type(data).__name__, "a JSON object")
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    _refuse_infinite(data, name)
    found = jsonschema.Draft202012Validator(solution_schema()).iter_errors(data)
    errors = sorted(found, key=lambda e: list(map(str, e.absolute_path)))
    if errors:
        where = ".".join(str(part) for part in errors[0].absolute_path) or "top level"
        raise InputError(f"{name}: {where}", errors[0].message, EXPECTED)
    check_kinds(data, name)
    return cast(SolutionData, data)


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a number in JSON")


def _bounded_int(text: str) -> int:
    if len(text) > 18:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _refuse_infinite(value: object, name: str, where: str = "") -> None:
    """Refuse numbers too large for a float, which JSON reads as infinity."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{name}: {where or 'top level'}", "a number too large for a float", "finite numbers")
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_infinite(item, name, f"{where}.{key}".lstrip("."))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            _refuse_infinite(item, name, f"{where}.{index}".lstrip("."))


def depth(text: str) -> int:
    """Return the deepest nesting of brackets outside strings, without parsing."""
    depth = deepest = 0
    inside = escaped = False
    for character in text:
        if inside:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                inside = False
        elif character == '"':
            inside = True
        elif character in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif character in "]}":
            depth -= 1
    return deepest
