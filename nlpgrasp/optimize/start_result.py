"""Result of one start: record, grasp, certificate and hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.contacts.pad import AlongNormalError
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState, SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import budget_at
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, constraint_reports
from nlpgrasp.optimize.kkt_point import LocalOptimum
from nlpgrasp.optimize.polish import PolishedGrasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.measures import certify
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.obstructions import LinkPenetration
from nlpgrasp.solution.records import CandidateOrigin, ConstraintReport, StartRecord, Status

STEP, NEWTON = "then IPOPT on the program", "then Newton steps on the program"  # messages of a start at an optimum
TIE = 0.03  # relative difference up to which the lower bounds of two starts are a tie
SOLVER_ERRORS = RuntimeError, ArithmeticError, np.linalg.LinAlgError, AlongNormalError
"""Errors that numerics may raise for some candidates; any other error is a defect of the program."""
Item = TypeVar("Item")


@dataclass(frozen=True)
class StartResult:
    """Result of one start; only a ``StartGrasp`` has a grasp.

    Parameters
    ----------
    record : StartRecord
    """

    record: StartRecord

    @property
    def solved(self) -> bool:
        """Whether the start ended with a certified, feasible grasp whose links do not collide."""
        return self.record.status is Status.SOLVED

    @property
    def effort(self) -> SolverEffort:
        """Solver effort of the start, in iterations and seconds."""
        return SolverEffort()


@dataclass(frozen=True)
class StartGrasp(StartResult):
    """Result of one start with its final grasp, feasible or not.

    Parameters
    ----------
    record : StartRecord
    on_body : GraspOnBody
        The grasp on the body itself.
    constraints : tuple of ConstraintReport
    total_effort : SolverEffort
        Solver effort.
    robust : Robustness or None
        Robustness, where it was computed.
    refined_candidate : GraspCandidate
        Candidate at the end of the local search, before its contacts were projected onto a mesh.
    optimum : LocalOptimum or None
        Local optimum, where the answer is at one.
    kkt : KKT or None
        KKT residuals of the answer.
    depth : LinkPenetration or None
        Penetration of the links, with a hand whose links have shapes.
    hull_depth : float
        Depth of the deepest link in body and surroundings with each shape as its convex hull, as in MuJoCo, metres.
    tip_gaps : tuple of (float or None)
        Distance of each contact from its fingertip's link, metres, with a hand that has links.
    hand : mapping or None
        Record of the hand with its approach and pregrasp, where these were computed.
    volume : float or None
        Sampled nu at a torque scale of 1 m, for the objective nu.
    is_settled : bool
        False where the search ended before the local optimum, which then follows if this is the best start.
    """

    on_body: GraspOnBody
    constraints: tuple[ConstraintReport, ...]
    total_effort: SolverEffort
    robust: Robustness | None
    refined_candidate: GraspCandidate
    optimum: LocalOptimum | None = None
    kkt: KKT | None = None
    depth: LinkPenetration | None = None
    hull_depth: float = 0.0
    tip_gaps: tuple[float | None, ...] = ()
    hand: Json | None = None
    volume: float | None = None
    is_settled: bool = True

    @classmethod
    def of(
        cls,
        compiled: CompiledProblem,
        index: int,
        on_body: GraspOnBody,
        bounds: Bounds,
        state: SearchState,
        message: str,
        seconds: Mapping[str, float] | None = None,
        robust: Robustness | None = None,
        origin: CandidateOrigin | None = None,
    ) -> StartGrasp:
        """Return the result of a start with its record: solved if certified, feasible and free of collisions."""
        depth, gaps, links, hulls = None, list[float | None](), compiled.link_depths, compiled.hull_depths
        in_hulls = [] if hulls is None else hulls.in_surroundings(on_body.candidate.hand)
        if links is not None:
            depth = links.in_posture(on_body.candidate.hand) if links.has_shapes else None
            gaps = links.tip_gaps(on_body.candidate.hand, on_body.grasp.points)
        status = Status.SOLVED if bounds.lower > 0.0 and on_body.is_feasible else Status.NO_GRASP
        collides = depth is not None and not depth.is_free
        if collides and status is Status.SOLVED:
            status = Status.TOUCHES
        record = StartRecord(
            index,
            status,
            on_body.candidate.faces,
            bounds,
            on_body.violation,
            state.effort.iterations,
            seconds=seconds or {},
            message=message,
            history=tuple(state.history),
            obstruction=depth.words if depth is not None and collides else "",
            origin=origin,
        )
        return cls(
            record,
            on_body,
            constraint_reports(compiled, on_body, state.multipliers),
            state.effort,
            robust,
            state.candidate,
            depth=depth,
            hull_depth=max((penetration.depth for penetration in in_hulls), default=0.0),
            tip_gaps=tuple(gaps),
        )

    @classmethod
    def at_optimum(
        cls,
        compiled: CompiledProblem,
        index: int,
        polished: PolishedGrasp,
        message: str,
        origin: CandidateOrigin,
        seconds: Mapping[str, float] | None = None,
    ) -> StartGrasp:
        """Return the result of a start that ended with the polish of a hand's candidate."""
        if polished.optimum is not None:
            message = ", ".join((message, STEP if polished.optimum.effort.calls else NEWTON))
        on_body, bounds = polished.on_body, polished.bounds
        start = cls.of(compiled, index, on_body, bounds, polished.state, message, seconds, origin=origin)
        return replace(start, optimum=polished.optimum, kkt=polished.kkt)

    @property
    def effort(self) -> SolverEffort:
        """Solver effort of the start, in iterations and seconds."""
        return self.total_effort

    @property
    def ranking_bounds(self) -> Bounds:
        """Bounds on the quality by which starts are ranked.

        The quality is nu where that is the objective, else robust mu where it is computed, else mu.
        """
        if self.volume is not None:
            return Bounds(self.volume, self.volume)
        return self.record.mu if self.robust is None else self.robust.mu

    def with_message(self, message: str) -> StartGrasp:
        """Return the start with a text appended to its message; unchanged for an empty text."""
        parts = ", ".join(part for part in (self.record.message, message) if part)
        return replace(self, record=replace(self.record, message=parts)) if message else self

    def tighten_bounds(
        self, problem: GraspProblem, rtol: float, seed: int = 0, deadline: float | None = None
    ) -> StartGrasp:
        """Return the start with its certificate tightened to a relative gap of ``rtol``."""
        previous, candidate = self.record.mu, self.on_body.candidate
        if previous.gap <= rtol:
            return self
        grasp, budget = self.on_body.grasp, budget_at(problem, candidate)
        tight = certify(grasp, problem.task, rtol, budget, seed, deadline)
        above = min(tight, previous, key=lambda bounds: bounds.upper)  # with the direction that it is of
        below = max(tight, previous, key=lambda bounds: bounds.lower)  # with the vertices that prove it
        bounds = replace(above, lower=below.lower, vertices=below.vertices, limit=tight.limit, trust=tight.trust)
        return replace(self, record=replace(self.record, mu=bounds))


def attempt(work: Callable[[], Item]) -> tuple[Item | None, str]:
    """Return the result of a call and an empty message, or None and the error's text where numerics fail."""
    try:
        return work(), ""
    except SOLVER_ERRORS as error:
        return None, format_error(error)


def format_error(error: Exception) -> str:
    """Return the kind and the first line of an error."""
    return f"{type(error).__name__}: {error}".splitlines()[0]


def best_of(results: Sequence[StartResult]) -> StartGrasp | None:
    """Return the best solved start; with none solved, the best whose only flaw is a collision.

    Among the starts whose lower bounds are close to the largest, the one with the largest upper bound is the best:
    lower bounds differ by chance within their certificates' gap, while upper bounds are nearly always the values
    themselves. Of equal upper bounds, the earliest start is the best.
    """
    grasps = [r for r in results if isinstance(r, StartGrasp) and r.record.has_grasp]
    eligible = [r for r in grasps if r.solved] or grasps
    if not eligible:
        return None
    best_lower = max(r.ranking_bounds.lower for r in eligible)
    least_lower = (1.0 - TIE) * best_lower
    tied = [r for r in eligible if r.ranking_bounds.upper >= best_lower and r.ranking_bounds.lower >= least_lower]
    return max(tied, key=lambda r: (r.ranking_bounds.upper, -r.record.index))
