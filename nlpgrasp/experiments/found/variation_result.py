"""What the solves of one variation found."""

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
        One a seed.
    """

    name: str
    solves: tuple[SolveRecord, ...]

    @property
    def best(self) -> SolveRecord | None:
        """Record of the solve with the best certified bounds; None where there is none."""
        return max((s for s in self.solves if s.success), key=lambda s: (s.mu.upper, s.mu.lower), default=None)

    @cached_property
    def mu(self) -> Bounds:
        """Bounds on the quality of the best grasp that any of the solves found; ``[0, 0]`` without one."""
        found = [s.mu for s in self.solves if s.success]
        return Bounds(max(b.lower for b in found), max(b.upper for b in found)) if found else NOTHING

    @property
    def best_possible(self) -> float:
        """Certified bound on mu over all placements: the least that its solves state; inf where there is none."""
        return min((s.best_possible for s in self.solves), default=math.inf)

    @property
    def gap(self) -> float:
        """By how much of its own quality the best grasp misses the best possible, at most; inf if nothing says so."""
        return max(0.0, self.best_possible / self.mu.lower - 1.0) if self.mu.lower > 0.0 else math.inf

    @property
    def gap_text(self) -> str:
        """The gap as tables show it, empty where there is none."""
        return percent(self.gap)

    @property
    def done(self) -> int:
        """How many solves have a solution."""
        return sum(s.done for s in self.solves)

    @property
    def starts(self) -> tuple[int, int]:
        """How many starts found a certified grasp, and how many there were."""
        return sum(s.succeeded for s in self.solves), sum(len(s.starts) for s in self.solves)

    @property
    def found(self) -> str:
        """What was found, in words: the certified interval, or why there is none."""
        if self.best is not None:
            return str(self.mu)
        return "no grasp" if self.done else "not done" if self.failures[0].failure == NOT_DONE else "failed"

    @property
    def agreeing(self) -> int:
        """How many solves found a grasp as good as the best, as far as the certified bounds tell."""
        return sum(s.success and s.mu.upper >= self.mu.lower for s in self.solves)

    @property
    def seconds(self) -> float:
        """Median wall time of a solve, seconds."""
        return median([s.seconds for s in self.solves if s.done] or [0.0])

    @property
    def failures(self) -> tuple[SolveRecord, ...]:
        """Records of the solves without a solution."""
        return tuple(s for s in self.solves if not s.done)
