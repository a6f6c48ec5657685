"""JSON Schema of solution files: check of registered kinds, and typed dictionaries."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from typing import NotRequired, TypeAlias, TypedDict

from nlpgrasp.budgets.registry import BUDGETS, NAMED
from nlpgrasp.common.types import Json
from nlpgrasp.contacts.base import CONTACTS
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import TASKS

SCHEMA_NAME = "nlpgrasp/1"
EXPECTED = "what schema 1 says (docs/json.md)"


@lru_cache
def solution_schema() -> Json:
    """Return the JSON Schema of solution files (schema 1)."""
    text = files(__name__).joinpath("nlpgrasp-1.schema.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def check_kinds(data: Json, name: str) -> None:
    """Refuse schema-valid data with contacts, a task or a budget of an unregistered kind.

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
        raise InputError(f"{name}: problem.task", _misfit(task), EXPECTED)
    budget = data["problem"]["force_budget"]
    if not (budget in NAMED if isinstance(budget, str) else BUDGETS.find(budget["type"])):
        raise InputError(f"{name}: problem.force_budget", _misfit(budget), EXPECTED)


def _known_task(task: Json) -> bool:
    """Return whether a task and all its parts are of known kinds."""
    terms = task["tasks"] if task["type"] == "sum" else ()
    return TASKS.find(task["type"]) is not None and all(_known_task(term) for term in terms)


def _misfit(value: object) -> str:
    return f"{value!r} is not valid under any of the given schemas"


Vector: TypeAlias = list[float]
Measure: TypeAlias = Mapping[str, float]  # an interval in the JSON form of Bounds and Volume


class MuData(TypedDict):
    """Type of the entry ``quality.mu``."""

    lower: float
    upper: float
    kind: str
    worst_direction: NotRequired[Vector | None]
    beta: NotRequired[Measure]
    limit: NotRequired[str]


class RobustData(TypedDict):
    """Type of the entry ``quality.robust``."""

    offset: float
    friction_share: float
    mu: Measure
    positions: list[Vector]
    normals: list[Vector]
    lost: NotRequired[list[int]]
    share: NotRequired[float]
    fragile: NotRequired[bool]


class GlobalBoundData(TypedDict):
    """Type of the entry ``quality.best_possible``."""

    upper: float
    gap: float | None
    nodes: NotRequired[int]
    dropped: NotRequired[list[str]]
    certificate: NotRequired[Json]


class FingerForceData(TypedDict):
    """Type of the items of ``quality.forces_needed.fingers``."""

    force: Vector
    normal: float
    size: float
    largest: float
    moment: NotRequired[Vector]


class NeededData(TypedDict):
    """Type of the entry ``quality.forces_needed``."""

    wrench: Vector
    fingers: list[FingerForceData]
    largest: float
    finger: int
    total: float
    budget: Measure
    within_max_force: NotRequired[bool]


class QualityData(TypedDict):
    """Type of the entry ``quality``."""

    mu: MuData | None
    best_possible: NotRequired[GlobalBoundData]
    delta: NotRequired[Measure | None]
    nu: NotRequired[Measure | None]
    robust: NotRequired[RobustData | None]
    forces_needed: NotRequired[NeededData | None]


class ContactData(TypedDict):
    """Type of the items of ``grasp.contacts``, which also have the entries of their contact model."""

    position: Vector
    normal: Vector
    tangents: list[Vector]
    face: NotRequired[str]
    surface_distance: NotRequired[float]
    surface_angle: NotRequired[float]
    normal_angle: NotRequired[float]
    moved: NotRequired[float]


class GraspData(TypedDict):
    """Type of the entry ``grasp``."""

    dimension: int
    torque_origin: Vector
    contacts: list[ContactData]


class ForcesData(TypedDict):
    """Type of the items of ``forces``."""

    direction: Vector
    forces: list[Vector]
    moments: NotRequired[list[Vector]]


class ConstraintData(TypedDict):
    """Type of the items of ``constraints``; None for no limit."""

    name: str
    value: float
    bound: list[float | None]
    multiplier: float
    active: bool
    kind: NotRequired[str]
    fingers: NotRequired[list[int]]


class PriceData(TypedDict):
    """Type of the items of ``shadow_prices``."""

    name: str
    value: float
    step: float
    unit: str
    gain: float


class KKTData(TypedDict):
    """Type of the entry ``kkt``."""

    stationarity: float
    feasibility: float
    complementarity: float
    locally_optimal: bool
    directions: NotRequired[list[Vector]]
    weights: NotRequired[Vector]
    reason: NotRequired[str]


class ConflictData(TypedDict):
    """Type of the items of ``why_not.conflicts``."""

    name: str
    row: str
    value: float
    bound: float
    relation: str
    unit: str


class WhyNotData(TypedDict):
    """Type of the entry ``why_not``."""

    conflicts: list[ConflictData]
    direction: Vector | None
    reasons: list[str]
    advice: list[str]
    locally_infeasible: bool


class StartData(TypedDict):
    """Type of the items of ``solver.starts``; None for unknown bounds and violation."""

    index: int
    status: str
    faces: list[str]
    mu: Measure | None
    violation: float | None
    iterations: int
    seconds: dict[str, float]
    message: str
    history: NotRequired[Vector]
    obstruction: NotRequired[str]
    origin: NotRequired[str]


class KeptGraspData(TypedDict):
    """Type of the items of ``grasps``, with the keys of a solution."""

    start: NotRequired[int | None]
    grasp: GraspData
    hand: NotRequired[Json | None]
    quality: QualityData
    forces: NotRequired[list[ForcesData]]
    constraints: NotRequired[list[ConstraintData]]


class SolverData(TypedDict, total=False):
    """Type of the entry ``solver``: in a solution with the versions, in a file with the starts."""

    seed: int
    iterations: int
    ipopt_calls: int
    ipopt_failures: dict[str, int]
    seconds: dict[str, float]
    options: Json
    keep: int
    distinct: float
    versions: dict[str, str]
    starts: list[StartData]


class SolutionData(TypedDict):
    """Type of a whole solution file."""

    schema: str
    created_by: NotRequired[dict[str, str]]
    status: str
    message: NotRequired[str]
    name: str
    problem: Json
    grasp: GraspData | None
    hand: NotRequired[Json | None]
    quality: QualityData
    forces: NotRequired[list[ForcesData]]
    constraints: NotRequired[list[ConstraintData]]
    shadow_prices: NotRequired[list[PriceData]]
    why_not: NotRequired[WhyNotData | None]
    drawing: NotRequired[Json | None]
    kkt: NotRequired[KKTData | None]
    best_start: NotRequired[int | None]
    grasps: NotRequired[list[KeptGraspData]]
    solver: NotRequired[SolverData]
