"""What was found: plain, frozen data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import ForceBudget, budget_from_dict
from nlpgrasp.common.drawing import Drawing
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, within
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.file import read, write
from nlpgrasp.solution.findings import Robustness, ShadowPrice, WhyNot
from nlpgrasp.solution.placed import HeldWrench, PlacedGrasp, SurfaceMatch
from nlpgrasp.solution.records import UNKNOWN, ConstraintReport, StartRecord, Status
from nlpgrasp.solution.schema import SCHEMA_NAME
from nlpgrasp.solution.schema.types import MuData, QualityData, SolutionData, SolverData
from nlpgrasp.tasks import Task, task_from_dict


@dataclass(frozen=True)
class GraspSolution:
    """A grasp found, its certified quality and the evidence.

    Parameters
    ----------
    status : Status
    name : str
        The problem's name.
    problem : mapping
        The problem as JSON data (see ``to_dict``).
    grasp : Grasp or None
    faces : tuple of str
        The face each contact is on.
    mu : Bounds
        Certified, of the grasp found; ``[0, inf]`` without a grasp.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds: (3.3-4a) for a centred task, (3.3-4b) otherwise.
    delta : Bounds or None
        Certified, with its torque scale; None where a stop came first.
    nu : Volume or None
        With the same torque scale.
    forces : sequence of (wrench, forces)
        Task wrenches ``mu.lower * (c + semi-axis)`` (d,) and finger forces (k, space) that produce them.
    moments : sequence of (k, d - space) array
        The moments about the contact points that go with the forces; empty when no contact exerts any.
    constraints : tuple of ConstraintReport
    prices : tuple of ShadowPrice
        What limits cost, those that bind first.
    robust : Robustness or None
        What is left of mu when contacts are off and friction is less.
    why_not : WhyNot or None
        Where no grasp was found.
    hand : mapping or None
        The hand at the solution: a URDF hand's joint positions, palm pose and pregrasp.
    surface : SurfaceMatch or None
        For meshes.
    drawing : Drawing or None
        Triangles of body and hand, for pictures.
    starts : tuple of StartRecord
        All starts, in order.
    solver : mapping
        Seed, seconds, options, versions.
    """

    status: Status
    name: str
    problem: Json
    grasp: Grasp | None = None
    faces: tuple[str, ...] = ()
    mu: Bounds = UNKNOWN
    kind: str = "mu"
    delta: Bounds | None = None
    nu: Volume | None = None
    forces: Sequence[tuple[FloatArray, FloatArray]] = ()
    moments: Sequence[FloatArray] = ()
    constraints: tuple[ConstraintReport, ...] = ()
    prices: tuple[ShadowPrice, ...] = ()
    robust: Robustness | None = None
    why_not: WhyNot | None = None
    hand: Json | None = None
    surface: SurfaceMatch | None = None
    drawing: Drawing | None = None
    starts: tuple[StartRecord, ...] = ()
    solver: SolverData = field(default_factory=SolverData)

    @property
    def success(self) -> bool:
        """Whether a grasp with a certified quality above zero was found."""
        return self.grasp is not None and self.mu.lower > 0.0

    @cached_property
    def task(self) -> Task:
        """Task that was asked for, about the grasp's torque origin."""
        return task_from_dict(self.problem["task"])

    @cached_property
    def budget(self) -> ForceBudget:
        """Meaning of one unit of finger force; of a hand's torques, in the posture found."""
        return budget_from_dict(self.problem["force_budget"])

    @property
    def body(self) -> Json:
        """The body as JSON data: its type and parameters."""
        return dict(self.problem["body"])

    @property
    def palm(self) -> str:
        """The link at the root of the hand that was asked for; ``"palm"`` where it is not stated."""
        hand = self.problem.get("hand")
        return str(hand.get("palm", "palm")) if isinstance(hand, Mapping) else "palm"

    @property
    def label(self) -> str:
        """The measure that ``mu`` holds, in words: ``"mu"`` or ``"mu-tilde"``."""
        return "mu-tilde" if self.kind == "mu_tilde" else "mu"

    def require_grasp(self) -> Grasp:
        """Return the grasp.

        Raises
        ------
        InputError
            Where none was found.
        """
        if self.grasp is None:
            raise InputError("solution", "no grasp", "a solution with a grasp")
        return self.grasp

    def require_drawing(self) -> Drawing:
        """Return the drawing of the grasp.

        Raises
        ------
        InputError
            Where no grasp was found, or an earlier version made the file.
        """
        if self.grasp is None or self.drawing is None:
            raise InputError("solution", "no grasp with a drawing", "a solution with a grasp, made by this version")
        return self.drawing

    def to_dict(self) -> SolutionData:
        """Return the solution as JSON data, schema 1 (docs/json.md)."""
        placed = None if self.grasp is None else PlacedGrasp(self.grasp, self.faces, self.surface)
        solver: SolverData = {**self.solver, "starts": [start.to_dict() for start in self.starts]}
        versions = solver.pop("versions", {})
        return {
            "schema": SCHEMA_NAME,
            "created_by": dict(versions),
            "status": self.status.name.lower(),
            "message": self.status.value,
            "name": self.name,
            "problem": dict(self.problem),
            "grasp": None if placed is None else placed.to_dict(),
            "hand": None if self.hand is None else dict(self.hand),
            "quality": self._quality(),
            "forces": [held.to_dict() for held in self._held()],
            "constraints": [report.to_dict() for report in self.constraints],
            "shadow_prices": [price.to_dict() for price in self.prices],
            "why_not": None if self.why_not is None else self.why_not.to_dict(),
            "drawing": None if self.drawing is None else self.drawing.to_dict(),
            "solver": solver,
        }

    def _quality(self) -> QualityData:
        """Return the measures as JSON data."""
        direction = self.mu.worst_direction
        mu: MuData = {
            "lower": self.mu.lower,
            "upper": self.mu.upper,
            "kind": self.kind,
            "worst_direction": None if direction is None else direction.tolist(),
        }
        return {
            "mu": mu if math.isfinite(self.mu.upper) else None,
            "delta": None if self.delta is None else self.delta.to_dict(),
            "nu": None if self.nu is None else self.nu.to_dict(),
            "robust": None if self.robust is None else self.robust.to_dict(),
        }

    def _held(self) -> list[HeldWrench]:
        """Return wrenches, forces and moments together."""
        moments = self.moments if len(self.moments) else [None] * len(self.forces)
        return [HeldWrench(w, f, m) for (w, f), m in zip(self.forces, moments, strict=True)]

    @classmethod
    def from_dict(cls, data: SolutionData, name: str = "solution") -> GraspSolution:
        """Return the solution that ``to_dict`` wrote.

        Parameters
        ----------
        data : mapping
            Of schema 1.
        name : str
            Of the data, for messages: a file's path.

        Raises
        ------
        InputError
            When numbers contradict each other.
        """
        placed = None if data["grasp"] is None else PlacedGrasp.from_dict(data["grasp"], f"{name}: grasp")
        quality, why_not, robust = data["quality"], data.get("why_not"), data["quality"].get("robust")
        delta, nu = quality.get("delta"), quality.get("nu")
        _check_problem(data["problem"], None if placed is None else placed.grasp, name)
        mu = _mu_of(quality["mu"], None if placed is None else placed.grasp, f"{name}: quality.mu")
        held = [HeldWrench.from_dict(entry, name) for entry in data.get("forces", [])]
        starts, solver = _solver_of(data, name)
        return cls(
            status=Status[data["status"].upper()],
            name=data["name"],
            problem=data["problem"],
            grasp=None if placed is None else placed.grasp,
            faces=() if placed is None else placed.faces,
            mu=mu,
            kind="mu" if quality["mu"] is None else quality["mu"]["kind"],
            delta=None if delta is None else Bounds.from_dict(delta, f"{name}: quality.delta"),
            nu=None if nu is None else Volume.from_dict(nu, f"{name}: quality.nu"),
            forces=tuple((entry.wrench, entry.forces) for entry in held),
            moments=_moments_of(held, name),
            constraints=tuple(map(ConstraintReport.from_dict, data.get("constraints", []))),
            prices=tuple(map(ShadowPrice.from_dict, data.get("shadow_prices", []))),
            robust=None if robust is None else Robustness.from_dict(robust, f"{name}: quality.robust"),
            why_not=None if why_not is None else WhyNot.from_dict(why_not),
            hand=data.get("hand"),
            surface=None if placed is None else placed.surface,
            drawing=Drawing.from_dict(data.get("drawing"), f"{name}: drawing"),
            starts=starts,
            solver=solver,
        )

    def save(self, path: str | Path) -> Path:
        """Write the solution as JSON (schema 1), atomically; return the path."""
        return write(self.to_dict(), path)

    @classmethod
    def load(cls, path: str | Path) -> GraspSolution:
        """Read a solution written by ``save``.

        Raises
        ------
        InputError
            When the file is missing, not JSON, too large, too deeply nested, or not of schema 1.
        """
        return cls.from_dict(read(path), str(path))

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.status.value}"]
        if self.grasp is not None:
            lines.append(f"  {self.label} certified in {self.mu} (gap {self.mu.gap:.1%})")
            for i, (p, n, face) in enumerate(zip(self.grasp.points, self.grasp.normals, self.faces, strict=True)):
                position, normal = (np.array2string(v, precision=5, suppress_small=True) for v in (p, n))
                lines.append(f"  contact {i} on {face}: position {position} m, inward normal {normal}")
        if self.robust is not None:
            lines.append(f"  {self.robust}")
        lines += [f"  {price}" for price in self.prices[:3]]
        if self.why_not is not None:
            lines += [f"  {line}" for line in (*self.why_not.reasons, *self.why_not.advice)]
        return "\n".join(lines)


def _check_problem(problem: Json, grasp: Grasp | None, name: str) -> None:
    """Refuse a task or a force budget that is not one, or does not fit the grasp."""
    with within(f"{name}: problem."):
        task = task_from_dict(problem["task"])
    if grasp is not None and task.dimension != grasp.dimension:
        raise InputError(f"{name}: problem.task", f"dimension {task.dimension}", f"dimension {grasp.dimension}")
    with within(f"{name}: problem."):
        budget = budget_from_dict(problem["force_budget"])
        if grasp is not None:
            budget.check(grasp.contacts, grasp.space)


def _mu_of(data: MuData | None, grasp: Grasp | None, field: str) -> Bounds:
    """Return the certified interval with its direction."""
    if data is None:
        return UNKNOWN
    stated, direction = data.get("worst_direction"), None
    if stated is not None:
        direction = array(f"{field}.worst_direction", stated, (None if grasp is None else grasp.dimension,))
        if not np.any(direction):
            raise InputError(f"{field}.worst_direction", "zero", "a direction")
    bounds = Bounds.from_dict({"lower": data["lower"], "upper": data["upper"]}, field)
    return replace(bounds, worst_direction=direction)


def _moments_of(held: Sequence[HeldWrench], name: str) -> tuple[FloatArray, ...]:
    """Return the moments, of all wrenches or of none."""
    moments = tuple(entry.moments for entry in held if entry.moments is not None)
    if moments and len(moments) != len(held):
        raise InputError(f"{name}: forces", f"{len(moments)} entries with moments", "moments in all or in none")
    return moments


def _solver_of(data: SolutionData, name: str) -> tuple[tuple[StartRecord, ...], SolverData]:
    """Return the starts and how the solve went; the JSON Schema says nothing of what is in them."""
    solver: SolverData = {**data.get("solver", {})}
    try:
        starts = tuple(StartRecord.from_dict(start) for start in solver.pop("starts", []))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{name}: solver", f"{type(error).__name__}: {error}", "what schema 1 says") from None
    return starts, {**solver, "versions": data.get("created_by", {})}
