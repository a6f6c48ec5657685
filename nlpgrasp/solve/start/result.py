"""What one start found."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.quality import Bounds
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solution.joint_room import JointRoom
from nlpgrasp.solution.records import ConstraintReport, StartRecord, Status
from nlpgrasp.solve.ascent.state import Effort
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.workbench.placed import Placed


@dataclass(frozen=True)
class StartResult:
    """What one start found: by itself, that of a start that ended without a grasp.

    Parameters
    ----------
    record : StartRecord
    """

    record: StartRecord

    @property
    def solved(self) -> bool:
        """Whether the start ended with a certified grasp that keeps the constraints."""
        return self.record.status is Status.SOLVED

    @property
    def effort(self) -> Effort:
        """What the start cost, in iterations and seconds."""
        return Effort()


@dataclass(frozen=True)
class StartGrasp(StartResult):
    """The grasp that a start ended with, whether it exerts the task and keeps the constraints or not.

    Parameters
    ----------
    record : StartRecord
    found : OnBody
    constraints : tuple of ConstraintReport
    spent : Effort
    robust : Robustness or None
        Where the solve goes by it.
    ascended : Placed
        Where the exchange ended, before the contacts went onto a mesh itself.
    room : JointRoom or None
        How far the hand's joints are from their limits, where that was looked at.
    """

    found: OnBody
    constraints: tuple[ConstraintReport, ...]
    spent: Effort
    robust: Robustness | None
    ascended: Placed
    room: JointRoom | None = None

    @property
    def effort(self) -> Effort:
        """What the start cost, in iterations and seconds."""
        return self.spent

    @property
    def rank(self) -> Bounds:
        """What starts are compared by: mu, or what is left of it at the worst placement."""
        return self.record.mu if self.robust is None else self.robust.mu
