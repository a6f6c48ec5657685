"""Following of a grasp along a changing task: stay, slide, regrasp or cold solve at each step."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.way_in import hand_posture
from nlpgrasp.solve.answer import solver_record
from nlpgrasp.solve.ascent.weakest import MISSED
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.put import on_body
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.studies.branches import Branches, moved
from nlpgrasp.studies.dynamic_grasp import DynamicStep
from nlpgrasp.studies.sliding import Branch, learn, slide

RTOL = 0.005  # largest relative gap of certificates; decisions depend on some percent
TRIED = 3  # most branches certified at a step before a cold solve
SLID_ON = 3  # most refinements of a branch whose certificate refutes its estimated quality


@dataclass(frozen=True)
class Held:
    """A grasp on the body, certified for a step's task.

    Parameters
    ----------
    state : Branch
        Branch of the grasp.
    found : OnBody
    bounds : Bounds
    """

    state: Branch
    found: OnBody
    bounds: Bounds

    @property
    def holds(self) -> bool:
        """Whether it exerts the task within the constraints."""
        return self.worth > 0.0

    @property
    def worth(self) -> float:
        """The certified quality; 0 with violated constraints."""
        return self.bounds.lower if self.found.allowed else 0.0


class Follower:
    """Follower of a changing task from step to step.

    Parameters
    ----------
    benches : sequence of Workbench
        One per step.
    starts : int
        Starts of a cold solve.
    seed : int
    gain : float
        Relative gain for which the fingers move.
    """

    def __init__(self, benches: Sequence[Workbench], starts: int, seed: int, gain: float) -> None:
        self._benches, self._seed, self._worthwhile = benches, seed, 1.0 + gain
        self._branches = Branches(benches, starts, seed)
        self._held: Held | None = None

    def step(self, index: int, parameter: float) -> DynamicStep:
        """Return the grasp for the task of step ``index``; steps are taken in their order."""
        bench, rng, begun = self._benches[index], np.random.default_rng(0), time.monotonic()
        before = self._held
        stayed = None if before is None else self._certified(bench, before.state, before.found)
        followed = self._followed(bench, stayed, rng)
        cold = followed is None and index > 0
        taken = followed or self._anew(bench, rng) or stayed
        self._held = taken
        if taken is None:
            return _without_grasp(bench.problem, parameter, cold, self._branches.bound)
        regrasp = before is not None and taken.state is not before.state
        went = np.zeros(len(taken.found.grasp))
        if before is not None and taken.found is not before.found:
            went = moved(before.found.grasp, taken.found.grasp, regrasp)
        effort = taken.state.effort
        record = solver_record(bench.options, self._seed, effort, time.monotonic() - begun)
        solution = replace(_solution(bench, taken), solver=record, bound=self._bound(taken))
        staying = taken.bounds.upper if stayed is None else stayed.bounds.upper
        return DynamicStep(parameter, solution, went, regrasp, staying, cold)

    def _followed(self, bench: Workbench, stayed: Held | None, rng: np.random.Generator) -> Held | None:
        """Return the grasp followed to another task, the current one refined or another branch's; None without any.

        The search for weak directions may overestimate the quality: the certificate decides.
        """
        branches = self._branches
        current = None if stayed is None else stayed.state
        branches.improve(bench, current, rng)
        best = stayed if stayed is not None and stayed.holds else None
        if best is not None and current is not None and current.value > self._worthwhile * best.worth:
            slid = self._on_body(bench, current, rng)
            best = slid if slid.worth > self._worthwhile * best.worth else best
        for state in branches.ranked()[:TRIED]:
            if best is not None and (state is current or state.value <= self._worthwhile * best.worth):
                continue
            other = self._on_body(bench, state, rng)
            if other.holds and (best is None or other.worth > self._worthwhile * best.worth):
                best = other
        return best

    def _bound(self, taken: Held) -> GlobalBound | None:
        """Return the global bound, raised to the grasp's own lower bound where that exceeds it by rounding."""
        bound = self._branches.bound
        return None if bound is None else replace(bound, upper=max(bound.upper, taken.bounds.lower))

    def _anew(self, bench: Workbench, rng: np.random.Generator) -> Held | None:
        """Return the best grasp of a cold solve, or None."""
        found = [self._on_body(bench, state, rng) for state in self._branches.cold(bench, rng)]
        return max((held for held in found if held.holds), key=lambda held: held.worth, default=None)

    def _on_body(self, bench: Workbench, state: Branch, rng: np.random.Generator) -> Held:
        """Return a branch's grasp on the body, refined further if its certificate refutes the estimated quality."""
        best = held = self._certified(bench, state, on_body(bench, state.placed, state.value, Stop()))
        for _ in range(SLID_ON):
            flattered = held.found.allowed and held.bounds.upper < (1.0 - MISSED) * state.value
            if not (flattered and learn(bench, state)):
                break
            slide(bench, state, self._branches.steps)
            held = self._certified(bench, state, on_body(bench, state.placed, state.value, Stop()))
            best = max(best, held, key=lambda h: h.worth)
        return best

    def _certified(self, bench: Workbench, state: Branch, found: OnBody) -> Held:
        rtol = min(bench.options.final_rtol, RTOL)
        return Held(state, found, mu(found.grasp, bench.problem.task, rtol, force_budget=bench.budget(found.placed)))


def _solution(bench: Workbench, held: Held) -> GraspSolution:
    """Return a step's grasp as a solution that can be saved and verified on its own."""
    problem, found = bench.problem, held.found
    budget = bench.budget(found.placed)
    start = StartGrasp.of(bench, 0, found, held.bounds, held.state, "")
    return GraspSolution(
        start.record.status if held.holds else Status.NO_GRASP,
        problem.name,
        problem.unchecked(force_budget=budget).to_dict(),
        grasp=found.grasp,
        faces=found.placed.faces,
        mu=held.bounds,
        kind=problem.task.measure,
        constraints=start.constraints,
        hand=hand_posture(bench, start),
        surface=found.surface,
    )


def _without_grasp(problem: GraspProblem, parameter: float, cold: bool, bound: GlobalBound | None) -> DynamicStep:
    """Return a step without a grasp, before any was found."""
    solution = GraspSolution(Status.NO_GRASP, problem.name, problem.to_dict(), kind=problem.task.measure, bound=bound)
    return DynamicStep(parameter, solution, np.zeros(len(problem.models)), False, 0.0, cold)
