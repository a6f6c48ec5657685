"""Solutions as JSON files, schema 1: written atomically, read without executing anything."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import jsonschema
import numpy as np

from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.schema import SCHEMA_NAME, solution_schema
from nlpgrasp.solution import UNKNOWN, ConstraintReport, GraspSolution, StartRecord, Status, SurfaceMatch
from nlpgrasp.validation import array

LARGEST_FILE = 64 * 1024 * 1024
DEEPEST = 50


def save(solution: GraspSolution, path: str | Path) -> Path:
    """Write the solution to ``path``: either the whole file is there afterwards or the old one is.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written.
    """
    target = Path(path)
    text = json.dumps(to_data(solution), indent=1, allow_nan=False) + "\n"
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp")
    except OSError as error:
        raise InputError(
            "out", f"{path} ({error.strerror})", "a file in a folder that exists and can be written"
        ) from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise InputError("out", f"{path} ({error.strerror})", "a file that can be written") from None
    return target


def load(path: str | Path) -> GraspSolution:
    """Read a solution; every way a file can be wrong is an :class:`InputError` naming the field."""
    return from_data(read_data(path), str(path))


def read_data(path: str | Path) -> dict[str, Any]:
    """Return the validated JSON data of a solution file."""
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


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the validated data of a JSON text; ``name`` is shown in messages."""
    if _depth(text) > DEEPEST:
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
    errors = sorted(_validator().iter_errors(data), key=lambda e: list(map(str, e.absolute_path)))
    if errors:
        where = ".".join(str(part) for part in errors[0].absolute_path) or "top level"
        raise InputError(f"{name}: {where}", errors[0].message, "what schema 1 says (docs/json.md)")
    return data


def to_data(solution: GraspSolution) -> dict[str, Any]:
    """Return the solution as JSON data."""
    return {
        "schema": SCHEMA_NAME,
        "created_by": dict(solution.solver.get("versions", {})),
        "status": solution.status.name.lower(),
        "message": solution.status.value,
        "name": solution.name,
        "problem": dict(solution.problem),
        "grasp": _grasp_data(solution),
        "hand": solution.hand if solution.hand is None else dict(solution.hand),
        "quality": {"mu": _bounds_data(solution.mu, solution.kind), "delta": None, "nu": None},
        "forces": [{"direction": w.tolist(), "forces": f.tolist()} for w, f in solution.forces],
        "constraints": [
            {
                "name": c.name,
                "value": c.value,
                "bound": [_finite_or_none(c.lower), _finite_or_none(c.upper)],
                "multiplier": c.multiplier,
                "active": c.active,
            }
            for c in solution.constraints
        ],
        "solver": {
            **{k: v for k, v in solution.solver.items() if k != "versions"},
            "starts": [_start_data(s) for s in solution.starts],
        },
    }


def from_data(data: Mapping[str, Any], name: str) -> GraspSolution:
    """Return the solution of validated data; numbers that contradict each other are refused."""
    grasp: Grasp | None = None
    faces: tuple[str, ...] = ()
    surface: SurfaceMatch | None = None
    if data["grasp"] is not None:
        grasp, faces, surface = _grasp_of(data["grasp"], name)
    quality = data["quality"]["mu"]
    bounds, kind = UNKNOWN, "mu"
    if quality is not None:
        direction = quality.get("worst_direction")
        if direction is not None:
            direction = array(f"{name}: quality.mu.worst_direction", direction, (None,))
        bounds = Bounds(quality["lower"], quality["upper"], direction)
        kind = quality["kind"]
    solver = dict(data.get("solver", {}))
    try:
        starts = tuple(_start_of(s) for s in solver.pop("starts", []))
        constraints = tuple(
            ConstraintReport(
                c["name"],
                c["value"],
                -math.inf if c["bound"][0] is None else c["bound"][0],
                math.inf if c["bound"][1] is None else c["bound"][1],
                c["multiplier"],
                c["active"],
            )
            for c in data.get("constraints", [])
        )
        forces = tuple(
            (array(f"{name}: direction", f["direction"], (None,)), array(f"{name}: forces", f["forces"], (None, None)))
            for f in data.get("forces", [])
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{name}: solver", f"{type(error).__name__}: {error}", "what schema 1 says") from None
    return GraspSolution(
        status=Status[data["status"].upper()],
        name=data["name"],
        problem=data["problem"],
        grasp=grasp,
        faces=faces,
        mu=bounds,
        kind=kind,
        forces=forces,
        constraints=constraints,
        hand=data.get("hand"),
        surface=surface,
        starts=starts,
        solver={**solver, "versions": data.get("created_by", {})},
    )


def _grasp_data(solution: GraspSolution) -> dict[str, Any] | None:
    grasp = solution.grasp
    if grasp is None:
        return None
    contacts = []
    for i, model in enumerate(grasp.contacts):
        entry = {
            "position": grasp.points[i].tolist(),
            "normal": grasp.normals[i].tolist(),
            "tangents": grasp.tangents[i].tolist(),
            "face": solution.faces[i],
            **model.to_dict(),
        }
        if solution.surface is not None:
            entry |= {
                "surface_distance": float(solution.surface.distances[i]),
                "surface_angle": float(solution.surface.angles[i]),
                "moved": float(solution.surface.moved[i]),
            }
        contacts.append(entry)
    return {"dimension": grasp.dimension, "torque_origin": grasp.torque_origin.tolist(), "contacts": contacts}


def _grasp_of(data: Mapping[str, Any], name: str) -> tuple[Grasp, tuple[str, ...], SurfaceMatch | None]:
    contacts = data["contacts"]
    try:
        grasp = Grasp(
            [c["position"] for c in contacts],
            [c["normal"] for c in contacts],
            [contact_from_dict(c) for c in contacts],
            data["torque_origin"],
            [c["tangents"] for c in contacts],
        )
    except InputError as error:
        raise InputError(f"{name}: grasp.{error.field}", error.given, error.allowed) from None
    if grasp.dimension != data["dimension"]:
        raise InputError(f"{name}: grasp.dimension", data["dimension"], f"{grasp.dimension}, as the positions say")
    surface = None
    if all("surface_distance" in c and "surface_angle" in c and "moved" in c for c in contacts):
        columns = ([c[key] for c in contacts] for key in ("surface_distance", "surface_angle", "moved"))
        surface = SurfaceMatch(*(np.array(column, float) for column in columns))
    return grasp, tuple(str(c.get("face", "")) for c in contacts), surface


def _start_data(record: StartRecord) -> dict[str, Any]:
    data = asdict(record)
    data["status"] = record.status.name.lower()
    data["faces"] = list(record.faces)
    data["mu"] = _bounds_data(record.mu, None)
    data["violation"] = _finite_or_none(record.violation)
    data["seconds"] = dict(record.seconds)
    return data


def _start_of(data: Mapping[str, Any]) -> StartRecord:
    mu = data.get("mu")
    return StartRecord(
        index=int(data["index"]),
        status=Status[str(data["status"]).upper()],
        faces=tuple(map(str, data["faces"])),
        mu=UNKNOWN if mu is None else Bounds(float(mu["lower"]), float(mu["upper"])),
        violation=math.inf if data["violation"] is None else float(data["violation"]),
        iterations=int(data["iterations"]),
        seconds={str(k): float(v) for k, v in data["seconds"].items()},
        message=str(data["message"]),
    )


def _bounds_data(bounds: Bounds, kind: str | None) -> dict[str, Any] | None:
    if not math.isfinite(bounds.upper):
        return None
    data: dict[str, Any] = {"lower": bounds.lower, "upper": bounds.upper}
    if kind is not None:
        data["kind"] = kind
        data["worst_direction"] = None if bounds.worst_direction is None else bounds.worst_direction.tolist()
    return data


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _validator() -> Any:
    return jsonschema.Draft202012Validator(solution_schema())


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a number in JSON")


def _bounded_int(text: str) -> int:
    if len(text) > 300:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _refuse_infinite(value: Any, name: str, where: str = "") -> None:
    """Refuse numbers too large for a float, which JSON reads as infinity."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{name}: {where or 'top level'}", "a number too large for a float", "finite numbers")
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_infinite(item, name, f"{where}.{key}".lstrip("."))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            _refuse_infinite(item, name, f"{where}.{index}".lstrip("."))


def _depth(text: str) -> int:
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


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
