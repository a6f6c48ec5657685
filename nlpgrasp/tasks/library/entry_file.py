"""JSON files of task library entries: atomic writing, and validated reading."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from nlpgrasp.common.files import read_text, write_text
from nlpgrasp.common.stored.strict_json import check_schema, read_object
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, within
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.library.entry import (
    LEARNT,
    SCHEMA_NAME,
    UNITS,
    Frame,
    Origin,
    TaskEntry,
    about_point,
    entry_name,
)
from nlpgrasp.version import __version__

if TYPE_CHECKING:
    import jsonschema

LARGEST_FILE = 64 * 1024 * 1024
EXPECTED = "what task schema 1 says (docs/task_libraries.md)"


@lru_cache
def entry_schema() -> Json:
    """Return the JSON Schema of entries of task libraries (task schema 1)."""
    return dict(json.loads(files(__package__).joinpath("nlpgrasp-task-1.schema.json").read_text(encoding="utf-8")))


@lru_cache
def _validator() -> jsonschema.Draft202012Validator:
    import jsonschema

    return jsonschema.Draft202012Validator(entry_schema())


def write_entry(entry: TaskEntry, path: Path) -> Path:
    """Write an entry's file atomically."""
    return write_text(path, text_of(entry))


def text_of(entry: TaskEntry) -> str:
    """Return an entry as JSON text, one field per line."""
    data = {
        "schema": SCHEMA_NAME,
        "created_by": {"nlpgrasp": __version__},
        **entry.summary(),
        "fit": entry.learnt.to_dict(),
    }
    del data["wrenches"], data["forgotten"]  # the fit says so
    lines = (f" {json.dumps(k)}: {json.dumps(v, ensure_ascii=False, allow_nan=False)}" for k, v in data.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_entry(path: Path) -> TaskEntry:
    """Read an entry from a file.

    Raises
    ------
    InputError
        When the file is truncated or invalid, or has other units or dimensions; it names the file and the field.
    """
    return parse_entry(read_text(path, "an entry of a task library", LARGEST_FILE), str(path))


def parse_entry(content: str, name: str) -> TaskEntry:
    """Parse an entry from JSON text; ``name`` is used in messages."""
    data = read_object(content, name)
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    units = data.get("units")
    for quantity, unit in UNITS.items():
        given = units.get(quantity, "nothing") if isinstance(units, dict) else units
        if given != unit:
            raise InputError(f"{name}: units.{quantity}", given, f"{unit!r}: entries are in SI units")
    check_schema(data, _validator(), name, EXPECTED)
    with within(f"{name}: "):
        return _entry(data)


def _entry(data: Json) -> TaskEntry:
    """Return the entry of data that conform to the schema."""
    d = data["dimension"]
    axes = array("task.axes", data["task"]["axes"], (None, d))
    task = TaskEllipsoid.from_axes(axes, array("task.center", data["task"]["center"], (d,)))
    learnt = LEARNT[data["fit"]["kind"]].from_dict(data["fit"], task)
    return TaskEntry(
        entry_name(data["name"]),
        learnt,
        Frame(data["frame"]["words"], about_point(data["frame"]["about"], d, "frame.about")),
        data["description"],
        tuple(data["tags"]),
        tuple(Origin(one["did"], one["source"], one["wrenches"], one["date"]) for one in data["provenance"]),
    )
