"""Record of one solve of an experiment, and digests that tell which solves can be compared."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.registry import body_from_dict
from nlpgrasp.common.formatting import error_line, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.problem.identity import DIGEST_ENTRY, data_digest
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.analysis_records import ShadowPrice
from nlpgrasp.solution.records import ConstraintReport, StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

NOTHING = Bounds(0.0, 0.0)  # mu without a grasp
NOT_DONE = "not done"  # failure text of a solve that has not run
LOOSE_GAP = 2.0  # relative gap above which a bound counts as loose
WARM_START_PREFIX = "from variation "  # prefix of the message of a warm start from another variation


def body_digest(body: Json) -> str:
    """Return a digest of a body's JSON data, or an empty text if the data are incomplete.

    Equal bodies have equal digests.
    """
    if body.get("type") != Mesh.kind:  # mesh data contain a fingerprint
        try:
            body_from_dict(body)
        except InputError:
            return ""
    data = {k: v for k, v in body.items() if k not in ("source", "unit")}
    return data_digest(data)


def measure_digest(solution: GraspSolution) -> str:
    """Return a digest of task and kind of force budget, which give mu its meaning."""
    text = json.dumps([solution.task.to_dict(), solution.budget.kind], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class SolveRecord:
    """Record of one solve of an experiment.

    Parameters
    ----------
    variation : str
    seed : int
    status : Status or None
        None without a solution: the solve failed or was not run.
    mu : Bounds
        Certified quality of the grasp; ``[0, 0]`` without one.
    kind : str
        ``"mu"`` or ``"mu_tilde"``.
    seconds : float
        Wall time.
    iterations : int
        Of IPOPT.
    starts : tuple of StartRecord
        Its own starts, without warm starts from other variations.
    active : tuple of str
        Constraints at their limits, with their fingers.
    prices : tuple of ShadowPrice
    contacts : int
    measured : str
        Digest of task and force budget: values of mu are comparable where it is equal.
    failure : str
        Why there is no solution, in one line.
    problem : str
        Digest of the problem's identity, with the settings of the solve; empty where the solution states none.
    earlier : bool
        Whether an earlier run solved it.
    best_start : StartRecord or None
        The start whose grasp the solution holds.
    body : str
        Digest of the body; empty where the solution does not state all of it.
    best_possible : float
        Certified bound on mu over all placements; inf where there is none.
    grasps : int
        Number of kept grasps.
    """

    variation: str
    seed: int
    status: Status | None = None
    mu: Bounds = NOTHING
    kind: str = "mu"
    seconds: float = 0.0
    iterations: int = 0
    starts: tuple[StartRecord, ...] = ()
    active: tuple[str, ...] = ()
    prices: tuple[ShadowPrice, ...] = ()
    contacts: int = 0
    measured: str = ""
    failure: str = ""
    problem: str = ""
    earlier: bool = False
    best_start: StartRecord | None = None
    body: str = ""
    best_possible: float = math.inf
    grasps: int = 0

    @classmethod
    def of(cls, variation: str, seed: int, solution: GraspSolution) -> SolveRecord:
        """Return the record of a solution.

        Raises
        ------
        InputError
            When the solution's solver record is not one of a solve.
        """
        try:
            return cls._of(variation, seed, solution)
        except (AttributeError, TypeError, ValueError, OverflowError, KeyError) as error:
            raise InputError("solver", error_line(error), "what a solve writes") from None

    @classmethod
    def _of(cls, variation: str, seed: int, solution: GraspSolution) -> SolveRecord:
        return cls(
            variation,
            seed,
            solution.status,
            solution.mu if solution.success else NOTHING,
            solution.kind,
            float(solution.solver.get("seconds", {}).get("total", 0.0)),
            min(int(solution.solver.get("iterations", 0)), 10**15),
            tuple(s for s in solution.starts if not s.message.startswith(WARM_START_PREFIX)),
            active_constraints(solution.constraints),
            solution.prices,
            len(solution.problem.get("contacts", ())),
            measure_digest(solution),
            problem=str(solution.solver.get(DIGEST_ENTRY, "")),
            best_start=solution.winner,
            body=body_digest(solution.problem["body"]),
            best_possible=solution.best_possible,
            grasps=len(solution.grasps),
        )

    @property
    def done(self) -> bool:
        """Whether the solve has a solution, with or without a grasp."""
        return self.status is not None

    @property
    def success(self) -> bool:
        """Whether there is a grasp with a certified quality above zero."""
        return self.mu.lower > 0.0

    @property
    def origin(self) -> str:
        """Variation and seed from which the grasp was taken, such as ``"smooth, seed 2"``; empty if from this solve."""
        message = "" if self.best_start is None else self.best_start.message
        return message.removeprefix(WARM_START_PREFIX) if message.startswith(WARM_START_PREFIX) else ""

    @property
    def gap(self) -> float:
        """Upper bound on the relative optimality gap of the grasp; inf without a global bound."""
        return max(0.0, self.best_possible / self.mu.lower - 1.0) if self.success else math.inf

    @property
    def gap_text(self) -> str:
        """Text of the gap for tables; empty without a gap."""
        return format_gap(self.gap)

    @property
    def succeeded(self) -> int:
        """Number of starts with a certified grasp."""
        return sum(s.status is Status.SOLVED for s in self.starts)

    @property
    def improvement_times(self) -> tuple[tuple[float, float], ...]:
        """Cumulative seconds and best certified lower bound so far, after each start."""
        points, elapsed, best = [], 0.0, 0.0
        for start in self.starts:
            elapsed += sum(start.seconds.values())
            best = max(best, start.mu.lower if start.status is Status.SOLVED else 0.0)
            points.append((elapsed, best))
        return tuple(points)


def format_gap(gap: float) -> str:
    """Return a gap as text for a table: in per cent, or above 100 % as a factor.

    A wide gap is "loose"; an infinite one is empty.
    """
    if gap > LOOSE_GAP:
        return "loose" if math.isfinite(gap) else ""
    return f"{gap:.1%}" if gap <= 1.0 else f"{format_upper(1.0 + gap, 2)} times"


def active_constraints(reports: Sequence[ConstraintReport]) -> tuple[str, ...]:
    """Return the names of the active inequality constraints with their fingers, such as ``"table, fingers 1, 2"``."""
    active: dict[str, list[tuple[int, ...]]] = {}
    for report in reports:
        if report.active and not report.is_equation:
            groups = active.setdefault(report.kind if report.fingers else report.name, [])
            if report.fingers and report.fingers not in groups:
                groups.append(report.fingers)
    return tuple(_format_fingers(name, fingers) for name, fingers in active.items())


def _format_fingers(name: str, fingers: Sequence[tuple[int, ...]]) -> str:
    """Return a constraint's name followed by its fingers, as text."""
    if not fingers:
        return name
    finger_text = ", ".join(" and ".join(map(str, group)) for group in fingers)
    return f"{name}, finger{'s' * (sum(map(len, fingers)) > 1)} {finger_text}"
