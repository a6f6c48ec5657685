"""Compact records of solutions for the rows of a set, with numbers and text stored separately.

Constraints are stored as their values in single precision, and names and limits as one text for all rows that state the
same ones. All other numbers round-trip exactly. The problem is stored once, beside the rows.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from nlpgrasp.common.files import json_round_trip, parse_json
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.solution.file import SCHEMA_NAME
from nlpgrasp.solution.solution import GraspSolution

LEFT_OUT = ("schema", "name", "problem", "drawing")  # stated by the set, or made anew
BUDGET = "force_budget"  # part of the problem that may depend on the posture
STATIC = ("name", "bound", "kind", "fingers")  # entries of a constraint that are the same in many rows

Record = Mapping[str, object]
"""Columns of a row: ``outline`` and ``constraint_names`` (text), ``numbers`` and ``constraint_values`` (bytes).

``proof`` has the content of a proof file, or is empty.
"""
COLUMNS = ("outline", "constraint_names", "numbers", "constraint_values", "proof")


def pack_solution(solution: GraspSolution) -> dict[str, object]:
    """Return the compact record of a solution.

    ``outline`` is its JSON text with zeros in place of all numbers that are not whole; ``numbers`` are these, 8 bytes
    each. ``constraint_values`` have 4 bytes each.
    """
    data = json_round_trip(solution.to_dict())
    content = {key: value for key, value in data.items() if key not in LEFT_OUT}
    constraints = content.pop("constraints")
    content[BUDGET] = data["problem"][BUDGET]
    content["active"] = [i for i, entry in enumerate(constraints) if entry["active"]]
    content["multipliers"] = {str(i): entry["multiplier"] for i, entry in enumerate(constraints) if entry["multiplier"]}
    numbers: list[float] = []
    outline = _without_numbers(content, numbers)
    names = [{key: entry[key] for key in STATIC if key in entry} for entry in constraints]
    return {
        "outline": _compact_json(outline),
        "constraint_names": _compact_json(names),
        "numbers": np.array(numbers, "<f8").tobytes(),
        "constraint_values": np.array([entry["value"] for entry in constraints], "<f4").tobytes(),
    }


def unpack_solution(record: Record, problem: Json, name: str, field: str) -> GraspSolution:
    """Return the solution that a compact record stores.

    Parameters
    ----------
    record : mapping
    problem : mapping
        The problem as JSON data.
    name : str
        The problem's name.
    field : str
        Name of the row in messages.

    Raises
    ------
    InputError
        On a record whose parts do not fit each other.
    """
    try:
        numbers = iter(np.frombuffer(_bytes(record["numbers"]), "<f8").tolist())
        data: dict[str, Any] = _with_numbers(parse_json(str(record["outline"])), numbers)
        values = np.frombuffer(_bytes(record["constraint_values"]), "<f4").astype(float).tolist()
        active, multipliers = set(data.pop("active")), data.pop("multipliers")
        entries = zip(parse_json(str(record["constraint_names"])), values, strict=True)
        data["constraints"] = [
            {**entry, "value": value, "multiplier": multipliers.get(str(i), 0.0), "active": i in active}
            for i, (entry, value) in enumerate(entries)
        ]
        stated = {**problem, BUDGET: data.pop(BUDGET)}
    except (ValueError, KeyError, TypeError, StopIteration, AttributeError) as error:
        raise InputError(
            field, f"no record of a grasp ({type(error).__name__})", "a row that ng.make_set wrote"
        ) from None
    return GraspSolution.from_dict(
        {"schema": SCHEMA_NAME, "name": name, "problem": stated, "drawing": None, **data}, field
    )


def _without_numbers(value: object, numbers: list[float]) -> object:
    """Return JSON data with every float replaced by 0.0, and append the floats to ``numbers``."""
    if isinstance(value, float):
        numbers.append(value)
        return 0.0
    if isinstance(value, Mapping):
        return {key: _without_numbers(item, numbers) for key, item in value.items()}
    return [_without_numbers(item, numbers) for item in value] if isinstance(value, list) else value


def _with_numbers(value: Any, numbers: Iterator[float]) -> Any:
    """Return JSON data with every float replaced by the next of ``numbers``."""
    if isinstance(value, float):
        return next(numbers)
    if isinstance(value, dict):
        return {key: _with_numbers(item, numbers) for key, item in value.items()}
    return [_with_numbers(item, numbers) for item in value] if isinstance(value, list) else value


def _bytes(value: object) -> bytes:
    """Return the value if it is bytes; raise otherwise."""
    if not isinstance(value, bytes):
        raise TypeError("no bytes")
    return value


def _compact_json(data: object) -> str:
    """Return data as JSON text without spaces."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)
