"""Records of a solve: status, starts, and constraint values at the solution."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from nlpgrasp.common.formatting import format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.record_fields import LATER, LEFT_OUT, NULL_IF_INFINITE, Record

UNKNOWN = Bounds(0.0, math.inf)  # quality without a grasp


class Status(Enum):
    """Outcome of a solve or of one of its starts.

    The value says what it means and what to do.
    """

    SOLVED = "Solved: a grasp with a certified quality above zero, a local optimum at best."
    OPTIMAL = "Optimal: a grasp with a certified quality within the gap asked for of the best that any placement has."
    TOUCHES = (
        "Touches: a link of the hand is inside the body, its surroundings or another link, in the grasp or on the way "
        "to it, and the hand cannot take this grasp. Try more starts, more clearance or other fingertips; no start "
        "found a free one."
    )
    NO_GRASP = (
        "No grasp found: no start ended with a certified quality above zero. Try more starts, other faces, "
        "more friction or fewer constraints; this is not a proof that none exists."
    )
    TIME_LIMIT = "Time limit: stopped before all starts were done; the result is the best grasp so far, if any."
    INTERRUPTED = "Interrupted: stopped by the user; the result is the best grasp so far, if any."
    LOCALLY_INFEASIBLE = (
        "Locally infeasible: from no start could all constraints be kept at once; the result names those that "
        "contradict each other. This is not a proof that they do everywhere."
    )
    FAILED = "Failed: every start ended with an error; the starts' messages in the result name it."


class CandidateOrigin(Enum):
    """Kind of a start's initial candidate; the value is the default message of the start."""

    RANDOM = "random surface samples, exchanged, or postures of a hand, raced"
    BOUND = "from the search of all placements"
    FACING = "from a pair of places that face each other"
    HELD = "a hand that holds the body"
    WARM_START = "improved from a known grasp"


@dataclass(frozen=True)
class StartRecord(Record):
    """Record of one start of the solve.

    Parameters
    ----------
    index : int
    status : Status
    faces : tuple of str
        The face each contact is on.
    mu : Bounds
        Certified quality of the start's grasp; ``[0, inf]`` without one, null in a file.
    violation : float
        Largest violation of a constraint, relative to its scale; inf when unknown, null in a file.
    iterations : int
        IPOPT iterations of the kept attempt; 0 where the start was warm and every step was a quadratic program.
    seconds : mapping
        Wall time by stage: ``propose``, ``first program``, ``refine``, ``certificate``, ``link depth``.
    message : str
        Message of the first program's solver, or the error.
    history : tuple of float
        Least support ratio before the refinement and after each of its rounds: estimates of mu from above.
    obstruction : str
        Why the hand cannot take the grasp, or not approach it straight, as text; empty without known obstructions.
    origin : CandidateOrigin or None
        Kind of its initial candidate; None for a start that did not begin, and in files of earlier versions.
    """

    index: int
    status: Status
    faces: tuple[str, ...] = ()
    mu: Bounds = field(default=UNKNOWN, metadata={**LATER, **NULL_IF_INFINITE})
    violation: float = field(default=math.inf, metadata=NULL_IF_INFINITE)
    iterations: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    history: tuple[float, ...] = field(default=(), metadata=LATER)
    obstruction: str = field(default="", metadata=LEFT_OUT)
    origin: CandidateOrigin | None = field(default=None, metadata=LEFT_OUT)

    @property
    def has_grasp(self) -> bool:
        """Whether the start ended with a certified, feasible grasp, even if links penetrate something."""
        return self.status in (Status.SOLVED, Status.TOUCHES)


@dataclass(frozen=True)
class ConstraintReport:
    """Value, limits and multiplier of one scalar constraint at the solution.

    Parameters
    ----------
    name : str
    value : float
        In the constraint's own unit (squared metres where the constraint is on a squared distance).
    lower, upper : float
        Limits, infinite for none.
    multiplier : float
        ``d mu / d limit`` of the active limit in the solve that led to the grasp, 0 when none is active.
    active : bool
        Within 1e-4 of its scale from a limit.
    kind : str
        Common kind of such constraints, for example ``"table"``; empty in files of older versions.
    fingers : tuple of int
        The contacts it involves.
    """

    name: str
    value: float
    lower: float
    upper: float
    multiplier: float
    active: bool
    kind: str = ""
    fingers: tuple[int, ...] = ()

    @property
    def is_equation(self) -> bool:
        """Whether the constraint is an equation, with equal limits."""
        return self.lower == self.upper

    def to_dict(self) -> Json:
        """Return the report as JSON data, with None for an infinite limit."""
        data: Json = {
            "name": self.name,
            "value": self.value,
            "bound": [_finite_or_none(self.lower), _finite_or_none(self.upper)],
            "multiplier": self.multiplier,
            "active": self.active,
        }
        if self.kind:
            return {**data, "kind": self.kind, "fingers": list(self.fingers)}
        return data

    @classmethod
    def from_dict(cls, data: Json) -> ConstraintReport:
        """Return the report that ``to_dict`` wrote."""
        lower, upper = data["bound"]
        return cls(
            data["name"],
            data["value"],
            -math.inf if lower is None else lower,
            math.inf if upper is None else upper,
            data["multiplier"],
            data["active"],
            data.get("kind", ""),
            tuple(data.get("fingers", ())),
        )


def read_starts(data: Json, name: str) -> tuple[tuple[StartRecord, ...], int | None, Json]:
    """Return the starts, the index of the winning start (or None), and the other solver data of a file.

    Raises
    ------
    InputError
        On an invalid start, or an answer of no start; ``name`` is shown in the message.
    """
    solver = data.get("solver", {})
    if not isinstance(solver, dict):
        raise InputError(f"{name}: solver", solver, "a JSON object")
    if not isinstance(solver.get("options", {}), dict):
        raise InputError(f"{name}: solver.options", solver["options"], "a JSON object")
    starts = tuple(
        StartRecord.from_dict(start, f"{name}: solver.starts.{i}") for i, start in enumerate(solver.get("starts", ()))
    )
    best_start = data.get("best_start")
    if best_start is not None and best_start not in [start.index for start in starts]:
        raise InputError(f"{name}: best_start", best_start, "the index of one of its starts")
    other_data = {key: value for key, value in solver.items() if key != "starts"}
    return starts, None if best_start is None else int(best_start), other_data


def status_message(status: Status, optimality: str) -> str:
    """Return the meaning of a status as text; for a solved grasp, with its local optimality if known."""
    if status is not Status.SOLVED or not optimality:
        return str(status.value)
    return str(status.value).replace("a local optimum at best", optimality)


def format_status(status: Status, message: str, gap: float, caveats: Sequence[str]) -> str:
    """Return a status as text, with the optimality gap if it is closed and warnings about the grasp.

    Parameters
    ----------
    status : Status
    message : str
        Its meaning.
    gap : float
        Relative optimality gap.
    caveats : sequence of str
        Warnings about the grasp.
    """
    if status is Status.OPTIMAL:
        message = f"Optimal within {format_upper(100.0 * gap)}%: {message.removeprefix('Optimal: ')}"
    head, _, meaning = message.partition(": ")
    if status is Status.TOUCHES:
        return f"{head}: {'; and '.join(caveats)}; {meaning.partition(', and ')[2]}"
    return f"{head}, but {'; and '.join(caveats)}; {meaning}" if caveats else message


def _finite_or_none(value: float) -> float | None:
    """Return a number if it is finite, else None."""
    return value if math.isfinite(value) else None
