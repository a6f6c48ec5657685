"""What one start found."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solution.placed import SurfaceMatch
from nlpgrasp.solution.records import ConstraintReport, StartRecord, Status


@dataclass(frozen=True)
class StartResult:
    """What one start found.

    Parameters
    ----------
    record : StartRecord
    grasp : Grasp or None
    constraints : tuple of ConstraintReport
    hand : mapping or None
        Values of the hand's variables, name to array.
    surface : SurfaceMatch or None
    robust : Robustness or None
        Where the solve goes by it.
    solver_seconds, function_seconds : float
        Time in IPOPT, and in function evaluations within it.
    """

    record: StartRecord
    grasp: Grasp | None = None
    constraints: tuple[ConstraintReport, ...] = ()
    hand: dict[str, FloatArray] | None = None
    surface: SurfaceMatch | None = None
    robust: Robustness | None = None
    solver_seconds: float = 0.0
    function_seconds: float = 0.0

    @property
    def solved(self) -> bool:
        """Whether the start ended with a certified grasp that keeps the constraints."""
        return self.record.status is Status.SOLVED

    @property
    def rank(self) -> Bounds:
        """What starts are compared by: mu, or what is left of it at the worst placement."""
        return self.record.mu if self.robust is None else self.robust.mu
