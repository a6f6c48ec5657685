"""Reading and writing of solution files: validated reading, atomic writing."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

from nlpgrasp.budgets.registry import BUDGETS, NAMED
from nlpgrasp.common.files import check_schema, read_object, read_text, refuse_overwriting_source, write_text
from nlpgrasp.common.types import Json
from nlpgrasp.contacts.base import CONTACTS
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import TASKS

SCHEMA_NAME = "nlpgrasp/1"
EXPECTED = "what schema 1 says (docs/json.md)"
LARGEST_FILE = 64 * 1024 * 1024
DEEPEST = 50


def write_solution(data: Json, path: str | Path) -> Path:
    """Write a solution's data to a file atomically, so that a failure leaves the old file.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written, or a mesh, a hand or a script has that name.
    """
    refuse_overwriting_source("GraspSolution.save", Path(path))
    return write_text(path, solution_json(data))


def solution_json(data: Json) -> str:
    """Return a solution's data as indented JSON text.

    Each kept grasp and the drawing are on one line.
    """
    outline = json.dumps({k: v for k, v in data.items() if k not in ("grasps", "drawing")}, indent=1, allow_nan=False)
    grasps = ",\n  ".join(map(_json_line, data.get("grasps", [])))
    grasp_lines = f' "grasps": [\n  {grasps}\n ],\n' if grasps else ""
    return f'{outline[:-2]},\n{grasp_lines} "drawing": {_json_line(data.get("drawing"))}\n}}\n'


def _json_line(data: object) -> str:
    """Return data as JSON text on one line."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def read_solution_data(path: str | Path) -> Json:
    """Return the validated data of a solution file; raise ``InputError`` if the file is invalid."""
    return parse(read_text(path, "a solution file", LARGEST_FILE), str(path))


def parse(text: str, name: str) -> Json:
    """Return the validated data of a solution in JSON text.

    ``name`` is shown in messages.
    """
    import jsonschema

    if depth(text) > DEEPEST:
        raise InputError(name, f"nesting deeper than {DEEPEST}", "a solution file (schema 1)")
    data = read_object(text, name)
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    check_schema(data, jsonschema.Draft202012Validator(solution_schema()), name, EXPECTED)
    check_kinds(data, name)
    return data


@lru_cache
def solution_schema() -> Json:
    """Return the JSON Schema of solution files (schema 1) from the file that ``docs/make_schema.py`` updates."""
    text = files("nlpgrasp.solution").joinpath("schema/nlpgrasp-1.schema.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def check_kinds(data: Json, name: str) -> None:
    """Raise ``InputError`` for contacts, a task or a budget of an unregistered kind.

    Parameters
    ----------
    data : dict
        Data of the whole file.
    name : str
        Name of the file, for messages.
    """
    kept_grasps = {f"grasps.{i}.grasp": entry["grasp"] for i, entry in enumerate(data.get("grasps", ()))}
    for field, grasp in {"grasp": data["grasp"], **kept_grasps}.items():
        for i, contact in enumerate([] if grasp is None else grasp["contacts"]):
            if CONTACTS.find(contact["model"]) is None:
                value = f"{contact['model']!r} is not one of {[*CONTACTS.names]}"
                raise InputError(f"{name}: {field}.contacts.{i}.model", value, EXPECTED)
    task = data["problem"]["task"]
    if not _known_task(task):
        raise InputError(f"{name}: problem.task", _unregistered_message(task), EXPECTED)
    budget = data["problem"]["force_budget"]
    if not (budget in NAMED if isinstance(budget, str) else BUDGETS.find(budget["type"])):
        raise InputError(f"{name}: problem.force_budget", _unregistered_message(budget), EXPECTED)


def _known_task(task: Json) -> bool:
    """Return whether a task and, for a sum, all its terms are of registered kinds."""
    terms = task["tasks"] if task["type"] == "sum" else ()
    return TASKS.find(task["type"]) is not None and all(_known_task(term) for term in terms)


def _unregistered_message(value: object) -> str:
    """Return the message about data of an unregistered kind."""
    return f"{value!r} is not valid under any of the given schemas"


def depth(text: str) -> int:
    """Return the largest nesting depth of brackets in JSON text."""
    depth = deepest = 0
    in_string = escaped = False
    for character in text:
        if in_string:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                in_string = False
        elif character == '"':
            in_string = True
        elif character in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif character in "]}":
            depth -= 1
    return deepest
