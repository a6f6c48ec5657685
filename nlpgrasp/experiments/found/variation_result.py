"""Result of one variation over its seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from statistics import median

from nlpgrasp.experiments.found.record import NOT_DONE, NOTHING, SolveRecord, percent
from nlpgrasp.quality import Bounds


@dataclass(frozen=True)
class VariationResult:
    """All solves of one variation.

    Parameters
    ----------
    name : str
        The variation's.
    solves : tuple of SolveRecord
        One per seed.
    """

    name: str
    solves: tuple[SolveRecord, ...]

    @property
    def best(self) -> SolveRecord | None:
        """Record of the solve with the best certified bounds; None without any."""
        return max((s for s in self.solves if s.success), key=lambda s: (s.mu.upper, s.mu.lower), default=None)

    @cached_property
    def mu(self) -> Bounds:
        """Certified bounds of the best grasp over all solves; ``[0, 0]`` without one."""
        found = [s.mu for s in self.solves if s.success]
        return Bounds(max(b.lower for b in found), max(b.upper for b in found)) if found else NOTHING

    @property
    def best_possible(self) -> float:
        """Certified bound on mu over all placements, the least of the solves' bounds; inf without one."""
        return min((s.best_possible for s in self.solves), default=math.inf)

    @property
    def gap(self) -> float:
        """Relative optimality gap of the best grasp, an upper bound; inf without a global bound."""
        return max(0.0, self.best_possible / self.mu.lower - 1.0) if self.mu.lower > 0.0 else math.inf

    @property
    def gap_text(self) -> str:
        """The gap as tables show it, empty without one."""
        return percent(self.gap)

    @property
    def done(self) -> int:
        """Number of solves with a solution."""
        return sum(s.done for s in self.solves)

    @property
    def starts(self) -> tuple[int, int]:
        """Number of starts with a certified grasp, and number of all starts."""
        return sum(s.succeeded for s in self.solves), sum(len(s.starts) for s in self.solves)

    @property
    def found(self) -> str:
        """The certified interval, or the reason for having none, as text."""
        if self.best is not None:
            return str(self.mu)
        return "no grasp" if self.done else "not done" if self.failures[0].failure == NOT_DONE else "failed"

    @property
    def agreeing(self) -> int:
        """Number of solves whose certified interval overlaps the best one."""
        return sum(s.success and s.mu.upper >= self.mu.lower for s in self.solves)

    @property
    def seconds(self) -> float:
        """Median wall time of a solve, seconds."""
        return median([s.seconds for s in self.solves if s.done] or [0.0])

    @property
    def failures(self) -> tuple[SolveRecord, ...]:
        """Records of the solves without a solution."""
        return tuple(s for s in self.solves if not s.done)
