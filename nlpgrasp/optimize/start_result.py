"""Result of one start: record, grasp, certificate and hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.contacts.pad import AlongNormalError
from nlpgrasp.optimize.candidate import Effort, GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import budget_at
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, constraint_reports
from nlpgrasp.optimize.kkt_point import LocalOptimum
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.obstructions import LinkPenetration
from nlpgrasp.solution.records import CandidateOrigin, ConstraintReport, StartRecord, Status

CLOSE = 0.03  # relative: lower bounds of starts this close are a tie
SOLVER_ERRORS = RuntimeError, ArithmeticError, np.linalg.LinAlgError, AlongNormalError
"""What numerics may raise for some candidates; any other error is one of the program."""
Item = TypeVar("Item")


@dataclass(frozen=True)
class StartResult:
    """Result of one start; on its own, of a start that ended without a grasp.

    Parameters
    ----------
    record : StartRecord
    """

    record: StartRecord

    @property
    def solved(self) -> bool:
        """Whether the start ended with a certified grasp that keeps the constraints, and that its hand can take."""
        return self.record.status is Status.SOLVED

    @property
    def effort(self) -> Effort:
        """What the start cost, in iterations and seconds."""
        return Effort()


@dataclass(frozen=True)
class StartGrasp(StartResult):
    """Final grasp of a start, feasible or not, with its measures and hand.

    Parameters
    ----------
    record : StartRecord
    found : GraspOnBody
    constraints : tuple of ConstraintReport
    spent : Effort
    robust : Robustness or None
        Where the solve goes by it.
    ascended : GraspCandidate
        Where the exchange ended, before the contacts went onto a mesh itself.
    optimum : LocalOptimum or None
        Of the answer, where it is at one.
    kkt : KKT or None
        Residuals of the answer.
    depth : LinkPenetration or None
        Penetration of the links, with a hand whose links have shapes.
    tip_gaps : tuple of (float or None)
        How far each contact is from its fingertip's link, metres, with a hand that has links.
    hand : mapping or None
        The hand with its way in, as files state it, where that was looked at.
    """

    found: GraspOnBody
    constraints: tuple[ConstraintReport, ...]
    spent: Effort
    robust: Robustness | None
    ascended: GraspCandidate
    optimum: LocalOptimum | None = None
    kkt: KKT | None = None
    depth: LinkPenetration | None = None
    tip_gaps: tuple[float | None, ...] = ()
    hand: Json | None = None

    @classmethod
    def of(
        cls,
        compiled: CompiledProblem,
        index: int,
        found: GraspOnBody,
        bounds: Bounds,
        state: SearchState,
        message: str,
        seconds: Mapping[str, float] | None = None,
        robust: Robustness | None = None,
        origin: CandidateOrigin | None = None,
    ) -> StartGrasp:
        """Return the result of a start with its record: solved if the grasp is certified, feasible and free."""
        depth, gaps, links = None, list[float | None](), compiled.link_depths
        if links is not None:
            depth = links.at(found.candidate.hand) if links.has_shapes else None
            gaps = links.tip_gaps(found.candidate.hand, found.grasp.points)
        status = Status.SOLVED if bounds.lower > 0.0 and found.is_feasible else Status.NO_GRASP
        touches = depth is not None and not depth.is_free
        if touches and status is Status.SOLVED:
            status = Status.TOUCHES
        record = StartRecord(
            index,
            status,
            found.candidate.faces,
            bounds,
            found.violation,
            state.effort.iterations,
            seconds=seconds or {},
            message=message,
            history=tuple(state.history),
            obstruction=depth.words if depth is not None and touches else "",
            origin=origin,
        )
        reports = constraint_reports(compiled, found, state.multipliers)
        return cls(record, found, reports, state.effort, robust, state.candidate, depth=depth, tip_gaps=tuple(gaps))

    @property
    def effort(self) -> Effort:
        """What the start cost, in iterations and seconds."""
        return self.spent

    @property
    def rank(self) -> Bounds:
        """Bounds by which starts are ranked: mu, or mu under the worst displacement."""
        return self.record.mu if self.robust is None else self.robust.mu

    def noted(self, message: str) -> StartGrasp:
        """Return the start with a further remark in its record's message; unchanged for an empty one."""
        parts = ", ".join(part for part in (self.record.message, message) if part)
        return replace(self, record=replace(self.record, message=parts)) if message else self

    def certified(self, problem: GraspProblem, rtol: float, seed: int = 0, deadline: float | None = None) -> StartGrasp:
        """Return the start with its certificate narrowed to this relative gap."""
        known, candidate = self.record.mu, self.found.candidate
        if known.gap <= rtol:
            return self
        budget = budget_at(problem, candidate)
        fine = mu(self.found.grasp, problem.task, rtol, force_budget=budget, seed=seed, deadline=deadline)
        bounds = replace(fine, lower=max(fine.lower, known.lower), upper=min(fine.upper, known.upper))
        return replace(self, record=replace(self.record, mu=bounds))


def attempt(work: Callable[[], Item]) -> tuple[Item | None, str]:
    """Return the result of some work and an empty message; where numerics fail, None and the error as text."""
    try:
        return work(), ""
    except SOLVER_ERRORS as error:
        return None, format_error(error)


def format_error(error: Exception) -> str:
    """Return the kind and the first line of an error."""
    return f"{type(error).__name__}: {error}".splitlines()[0]


def best_of(results: Sequence[StartResult]) -> StartGrasp | None:
    """Return the best solved start, the earliest of equals; with none solved, the best whose only flaw is a collision.

    The lower bounds of two starts differ by chance within their certificates' gap, while the upper bounds are nearly
    always the values themselves: among the starts whose lower bounds are that close, the largest upper bound wins.
    """
    ended = [r for r in results if isinstance(r, StartGrasp) and r.record.has_grasp]
    solved = [r for r in ended if r.solved] or ended
    if not solved:
        return None
    lower = max(r.rank.lower for r in solved)
    close = [r for r in solved if r.rank.upper >= lower and r.rank.lower >= (1.0 - CLOSE) * lower]
    return max(close, key=lambda r: (r.rank.upper, -r.record.index))
