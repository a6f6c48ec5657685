"""Solution file input and output: atomic writing, validated reading."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

from nlpgrasp.common.files import check_schema, read_object, read_text, refuse_overwriting_source, write_text
from nlpgrasp.errors import InputError
from nlpgrasp.solution.schema import EXPECTED, SCHEMA_NAME, SolutionData, check_kinds, solution_schema

LARGEST_FILE = 64 * 1024 * 1024
DEEPEST = 50


def write_solution(data: SolutionData, path: str | Path) -> Path:
    """Write a solution's data to ``path`` atomically: a failure leaves the old file.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written, or a mesh, a hand or a script has that name.
    """
    refuse_overwriting_source("GraspSolution.save", Path(path))
    return write_text(path, solution_json(data))


def solution_json(data: SolutionData) -> str:
    """Return a solution's data as indented JSON text, with each kept grasp and the drawing on one line."""
    outline = json.dumps({k: v for k, v in data.items() if k not in ("grasps", "drawing")}, indent=1, allow_nan=False)
    grasps = ",\n  ".join(map(_json_line, data.get("grasps", [])))
    grasp_lines = f' "grasps": [\n  {grasps}\n ],\n' if grasps else ""
    return f'{outline[:-2]},\n{grasp_lines} "drawing": {_json_line(data.get("drawing"))}\n}}\n'


def _json_line(data: object) -> str:
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def read_solution_data(path: str | Path) -> SolutionData:
    """Return the validated data of a solution file; raise ``InputError`` on any invalid file."""
    return parse(read_text(path, "a solution file", LARGEST_FILE), str(path))


def parse(text: str, name: str) -> SolutionData:
    """Return the validated data of a JSON text; ``name`` is shown in messages."""
    import jsonschema

    if depth(text) > DEEPEST:
        raise InputError(name, f"nesting deeper than {DEEPEST}", "a solution file (schema 1)")
    data = read_object(text, name)
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    check_schema(data, jsonschema.Draft202012Validator(solution_schema()), name, EXPECTED)
    check_kinds(data, name)
    return cast(SolutionData, data)


def depth(text: str) -> int:
    """Return the deepest nesting of brackets outside strings, without parsing the text."""
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
