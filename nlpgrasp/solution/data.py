"""Solutions as JSON data, schema 1, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from nlpgrasp.budgets import budget_from_dict
from nlpgrasp.common.drawing import Drawing
from nlpgrasp.common.validation import array
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.findings import ShadowPrice
from nlpgrasp.solution.quality_data import bounds_data, check_interval, delta_of, measure_data, nu_of
from nlpgrasp.solution.robust_data import robust_data, robust_of
from nlpgrasp.solution.schema import SCHEMA_NAME
from nlpgrasp.solution.solution import UNKNOWN, ConstraintReport, GraspSolution, StartRecord, Status, SurfaceMatch
from nlpgrasp.solution.why_not_data import why_not_data, why_not_of
from nlpgrasp.tasks import task_from_dict


def to_data(solution: GraspSolution) -> dict[str, Any]:
    """Return the solution as JSON data."""
    moments = len(solution.moments) > 0
    return {
        "schema": SCHEMA_NAME,
        "created_by": dict(solution.solver.get("versions", {})),
        "status": solution.status.name.lower(),
        "message": solution.status.value,
        "name": solution.name,
        "problem": dict(solution.problem),
        "grasp": _grasp_data(solution),
        "hand": solution.hand if solution.hand is None else dict(solution.hand),
        "quality": {
            "mu": bounds_data(solution.mu, solution.kind),
            "delta": measure_data(solution.delta),
            "nu": measure_data(solution.nu),
            "robust": robust_data(solution.robust),
        },
        "forces": [
            {
                "direction": w.tolist(),
                "forces": f.tolist(),
                **({"moments": solution.moments[i].tolist()} if moments else {}),
            }
            for i, (w, f) in enumerate(solution.forces)
        ],
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
        "shadow_prices": [asdict(p) for p in solution.prices],
        "why_not": why_not_data(solution.why_not),
        "drawing": None if solution.drawing is None else solution.drawing.to_dict(),
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
    _check_task(data["problem"]["task"], grasp, name)
    _check_budget(data["problem"]["force_budget"], grasp, name)
    quality = data["quality"]["mu"]
    bounds, kind = UNKNOWN, "mu"
    if quality is not None:
        direction = quality.get("worst_direction")
        if direction is not None:
            size = None if grasp is None else grasp.dimension
            direction = array(f"{name}: quality.mu.worst_direction", direction, (size,))
            if not np.any(direction):
                raise InputError(f"{name}: quality.mu.worst_direction", "zero", "a direction")
        bounds = Bounds(quality["lower"], quality["upper"], direction)
        kind = quality["kind"]
        check_interval(quality, f"{name}: quality.mu")
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
        prices = tuple(ShadowPrice(**p) for p in data.get("shadow_prices", []))
        why_not = why_not_of(data.get("why_not"))
        given = [f["moments"] for f in data.get("forces", []) if "moments" in f]
        moments = tuple(array(f"{name}: moments", m, (None, None)) for m in given)
        if given and len(given) != len(forces):
            raise InputError(f"{name}: forces", f"{len(given)} entries with moments", "moments in all or in none")
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
        delta=delta_of(data["quality"].get("delta"), name),
        nu=nu_of(data["quality"].get("nu"), name),
        forces=forces,
        moments=moments,
        constraints=constraints,
        prices=prices,
        robust=robust_of(data["quality"].get("robust"), name),
        why_not=why_not,
        hand=data.get("hand"),
        surface=surface,
        drawing=Drawing.from_dict(data.get("drawing"), f"{name}: drawing"),
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


def _check_task(data: Mapping[str, Any], grasp: Grasp | None, name: str) -> None:
    """Refuse a task that is none, or is not of the grasp's dimension."""
    try:
        task = task_from_dict(data)
    except InputError as error:
        raise InputError(f"{name}: problem.{error.field}", error.given, error.allowed) from None
    if grasp is not None and task.dimension != grasp.dimension:
        raise InputError(f"{name}: problem.task", f"dimension {task.dimension}", f"dimension {grasp.dimension}")


def _check_budget(data: Any, grasp: Grasp | None, name: str) -> None:
    """Refuse a force budget that is none, or does not fit the grasp's contacts."""
    try:
        budget = budget_from_dict(data)
        if grasp is not None:
            budget.check(grasp.contacts, grasp.space)
    except InputError as error:
        raise InputError(f"{name}: problem.{error.field}", error.given, error.allowed) from None


def _start_data(record: StartRecord) -> dict[str, Any]:
    data = asdict(record)
    data["status"] = record.status.name.lower()
    data["faces"] = list(record.faces)
    data["mu"] = bounds_data(record.mu, None)
    data["violation"] = _finite_or_none(record.violation)
    data["seconds"] = dict(record.seconds)
    data["history"] = list(record.history)
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
        history=tuple(map(float, data.get("history", ()))),
    )


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
