"""What was found: plain, frozen data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from nlpgrasp.common.drawing import Drawing
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.findings import Robustness, ShadowPrice, WhyNot

UNKNOWN = Bounds(0.0, float("inf"))


class Status(Enum):
    """How a solve, or one of its starts, ended. The value says what it means and what to do."""

    SOLVED = "Solved: a grasp with a certified quality above zero, locally optimal at most."
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


@dataclass(frozen=True)
class StartRecord:
    """One start of the solve.

    Parameters
    ----------
    index : int
    status : Status
    faces : tuple of str
        The face each contact is on.
    mu : Bounds
        Certified, of the grasp this start found; ``[0, inf]`` when it found none.
    violation : float
        Largest violation of a constraint row, relative to the row's scale; inf when unknown.
    iterations : int
        IPOPT iterations of all its solves.
    seconds : mapping
        Wall time by stage: ``screen``, ``vertex``, ``exchange``, ``mesh``, ``certificate``.
    message : str
        The vertex solver's own word, or the error.
    history : tuple of float
        The least ratio found before the exchange and after each of its rounds: how mu rose, from above.
    """

    index: int
    status: Status
    faces: tuple[str, ...] = ()
    mu: Bounds = UNKNOWN
    violation: float = float("inf")
    iterations: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    history: tuple[float, ...] = ()


@dataclass(frozen=True)
class ConstraintReport:
    """One scalar constraint at the solution.

    Parameters
    ----------
    name : str
    value : float
        In the constraint's own unit (squared metres where the constraint is on a squared distance).
    lower, upper : float
        Limits, infinite for none.
    multiplier : float
        ``d mu / d limit`` of the active limit at the last solve, 0 when none is active.
    active : bool
        Within 1e-4 of its scale from a limit.
    """

    name: str
    value: float
    lower: float
    upper: float
    multiplier: float
    active: bool


@dataclass(frozen=True)
class SurfaceMatch:
    """How far the solver's smooth surface is from the mesh at each contact.

    Parameters
    ----------
    distances : (k,) array
        From the solver's contact to the nearest point of the mesh, metres.
    angles : (k,) array
        Between the solver's normal and the mesh's at the final contact, radians.
    moved : (k,) array
        From the solver's contact to the final contact, metres: more than the distance where a contact slid
        over the mesh to a better triangle.
    """

    distances: FloatArray
    angles: FloatArray
    moved: FloatArray


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
    problem: Mapping[str, Any]
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
    hand: Mapping[str, Any] | None = None
    surface: SurfaceMatch | None = None
    drawing: Drawing | None = None
    starts: tuple[StartRecord, ...] = ()
    solver: Mapping[str, Any] = field(default_factory=dict)

    @property
    def success(self) -> bool:
        """Whether a grasp with a certified quality above zero was found."""
        return self.grasp is not None and self.mu.lower > 0.0

    def save(self, path: str | Path) -> Path:
        """Write the solution as JSON (schema 1), atomically; return the path."""
        from nlpgrasp.solution.file import save

        return save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> GraspSolution:
        """Read a solution written by ``save``.

        Raises
        ------
        InputError
            When the file is missing, not JSON, too large, too deeply nested, or not of schema 1.
        """
        from nlpgrasp.solution.file import load

        return load(path)

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.status.value}"]
        if self.grasp is not None:
            label = "mu-tilde" if self.kind == "mu_tilde" else "mu"
            lines.append(f"  {label} certified in {self.mu} (gap {self.mu.gap:.1%})")
            for i, (p, n, face) in enumerate(zip(self.grasp.points, self.grasp.normals, self.faces, strict=True)):
                position, normal = (np.array2string(v, precision=5, suppress_small=True) for v in (p, n))
                lines.append(f"  contact {i} on {face}: position {position} m, inward normal {normal}")
        if self.robust is not None:
            lines.append(f"  {self.robust}")
        lines += [f"  {price}" for price in self.prices[:3]]
        if self.why_not is not None:
            lines += [f"  {line}" for line in (*self.why_not.reasons, *self.why_not.advice)]
        return "\n".join(lines)
