"""Local search: maximisation of mu by cutting planes in a trust region.

The support inequalities (Li and Sastry 1986, equation 3.4-3) hold in the directions where the current grasp is weakest.
A step maximises beta in the linearised program plus the curvature of its Lagrangian; Newton steps return to the
constraints, and the weakest directions are searched again, until no step helps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.quadratic_program import QuadraticStep
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem, pack_variables
from nlpgrasp.optimize.cutting_planes import (
    exact_minimisers,
    missed_directions,
    nearest_to_binding,
    new_directions,
    weakest_directions_of,
)
from nlpgrasp.optimize.trust_region import ACTIVE, Linearisation, TrustRegionStep, reduced_hessian
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.weakest_directions import MISSED

LOOKS = 4  # certificates that look for directions missed by descents, at most
RADIUS, LARGEST_RADIUS = 0.03, 0.1  # trust-region radius over the body's size: initial, upper bound
EXPANSION, CONTRACTION = 1.5, 0.4  # factors of the trust-region radius after an accepted and a rejected step
STATIONARY = 1e-7  # solver units, change of the Lagrangian's gradient over a step at which refinement ends
NO_LOSS = 1e-9  # relative decrease that still counts as none
SMALL_GAIN = 0.02  # predicted relative gain of a step without curvature below which curvature is used
LEAST_GAIN, IDLE = 1e-4, 2  # relative gain below which a round is idle; idle rounds in a row that end a refinement
REJECTED = 8  # rejected steps in a row that end a refinement, as at kinks
FAIR = 0.5  # ratio of actual to predicted gain below which curvature is used


@dataclass(frozen=True)
class RefinementPoint:
    """Candidate with its weakest directions.

    Parameters
    ----------
    candidate : GraspCandidate
    value : float
        The least support ratio.
    minimisers : (m, d) array
        Local minimisers of the ratio, each with ``phi_A = 1``.
    nearby_cuts : (m', d) array
        Directions in which candidates nearby are weaker.
    """

    candidate: GraspCandidate
    value: float
    minimisers: FloatArray
    nearby_cuts: FloatArray

    @property
    def cuts(self) -> FloatArray:
        """Cutting planes: weakest directions of this candidate and of nearby ones, (m + m', d)."""
        return np.concatenate([self.minimisers, self.nearby_cuts])


@dataclass(frozen=True)
class RefinementResult:
    """Result of a local search: final point, multipliers and history.

    Parameters
    ----------
    point : RefinementPoint
    length : float
        Length of the last step, solver units.
    multipliers : (rows,) array
        Multipliers of the constraints on contacts and hand in the last step, solver units.
    history : tuple of float
        The least ratio initially and after each step.
    certificate : ResumableCertificate or None
        Certificate of the point, as far as it was needed to show that descents missed no direction.
    """

    point: RefinementPoint
    length: float
    multipliers: FloatArray
    history: tuple[float, ...] = ()
    certificate: ResumableCertificate | None = None

    def state(self) -> SearchState:
        """Return the result as the state of a local search."""
        point = self.point
        return SearchState(point.candidate, point.value, point.cuts, self.multipliers, history=list(self.history))


def evaluate_candidate(
    compiled: CompiledProblem, candidate: GraspCandidate, directions: FloatArray, rng: np.random.Generator
) -> RefinementPoint:
    """Return a candidate with its weakest directions, searched from given directions (m, d) and random ones."""
    weakest = exact_minimisers(compiled, candidate, rng, directions)
    return RefinementPoint(candidate, weakest.value, weakest.directions, weakest.directions[:0])


def refine(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    deadline: Deadline,
    rounds: int | None = None,
    least: float = LEAST_GAIN,
) -> RefinementResult:
    """Return a candidate refined by trust-region steps until these gain little.

    A candidate that does not exert the task is returned as it is. Steps end where two in a row gain less than a
    fraction ``least``, where the Lagrangian is flat, or after ``rounds`` steps. Descents may overestimate the value:
    the polytope of a certificate then gives the directions that they missed, and the search goes on with these, from
    the best previous point where the corrected value is no better than its value.
    """
    rng, rounds = np.random.default_rng(0), compiled.options.rounds if rounds is None else rounds
    best = result = _initial_result(compiled, candidate, rng)
    for _ in range(LOOKS):
        result = _iterate_steps(compiled, result, rng, deadline, rounds, least)
        point = result.point
        missed, certificate = missed_directions(compiled, point.candidate, point.value)
        if missed is None:
            return replace(result, certificate=certificate)
        directions = np.concatenate([missed.directions, point.minimisers])
        corrected = evaluate_candidate(compiled, point.candidate, directions, rng)
        value = min(corrected.value, missed.value)
        if value > best.point.value:
            corrected = replace(corrected, value=value, nearby_cuts=point.nearby_cuts)
            best = result = replace(result, point=corrected)
        else:
            cuts = np.concatenate([missed.directions, best.point.nearby_cuts])
            best = result = replace(best, point=replace(best.point, nearby_cuts=cuts))
        if deadline.should_stop():
            break
    return best


def advance(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    deadline: Deadline,
    rounds: int | None = None,
    least: float = LEAST_GAIN,
    known: FloatArray | None = None,
) -> RefinementResult:
    """Return a candidate refined by at most ``rounds`` trust-region steps, without certificates.

    Its value is good enough to compare candidates, though descents may have missed directions in which they are weaker.
    Descents begin from known directions (m, d) as well.
    """
    rng, rounds = np.random.default_rng(0), compiled.options.rounds if rounds is None else rounds
    return _iterate_steps(compiled, _initial_result(compiled, candidate, rng, known), rng, deadline, rounds, least)


def go_on(
    compiled: CompiledProblem,
    result: RefinementResult,
    deadline: Deadline,
    rounds: int,
    is_optimal: Callable[[RefinementPoint], bool],
) -> RefinementResult:
    """Return a result after at most ``rounds`` further steps, all with the Lagrangian's curvature."""
    search = _TrustRegionSearch(compiled, replace(result, length=RADIUS), np.random.default_rng(0), 0.0)
    tested = None
    for _ in range(rounds):
        if search.result.point.candidate is not tested:
            tested = search.result.point.candidate
            if is_optimal(search.result.point):
                break
        if deadline.should_stop() or search.has_ended or not search.try_step():
            break
    return search.result


def _initial_result(
    compiled: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator, known: FloatArray | None = None
) -> RefinementResult:
    """Return a candidate as the result of a refinement without steps."""
    weakest = weakest_directions_of(compiled, candidate, rng, known)
    point = evaluate_candidate(compiled, candidate, weakest.directions, rng)
    return RefinementResult(point, RADIUS, np.zeros(len(compiled.rows.named)), (point.value,))


def _iterate_steps(
    compiled: CompiledProblem,
    result: RefinementResult,
    rng: np.random.Generator,
    deadline: Deadline,
    rounds: int,
    least: float,
) -> RefinementResult:
    """Return the result after at most ``rounds`` trust-region steps; fewer if gains are small or time is up."""
    search = _TrustRegionSearch(compiled, result, rng, least)
    for _ in range(rounds):
        if deadline.should_stop() or search.has_ended or not search.try_step():
            break
    return search.result


class _TrustRegionSearch:
    """Trust-region iteration of a refinement.

    Parameters
    ----------
    compiled : CompiledProblem
    result : RefinementResult
    rng : numpy.random.Generator
    least : float
        Relative gain below which a round is idle; with 0 every step uses the curvature.
    """

    def __init__(
        self, compiled: CompiledProblem, result: RefinementResult, rng: np.random.Generator, least: float
    ) -> None:
        self.compiled, self.result, self.rng, self.least = compiled, result, rng, least
        self.initial = result.point
        self.radius = RADIUS
        self.idle = 0  # rounds in a row that gained less than the least
        self.rejected = 0  # steps in a row
        self.curvature: FloatArray | None = None  # reduced Hessian of the Lagrangian, (n, n)
        self.is_near = least == 0.0  # near the optimum, where steps need the curvature
        self.is_stale = True  # the curvature is of another point

    @property
    def has_ended(self) -> bool:
        """Whether the least support ratio is not positive, or the last rounds gained too little."""
        return self.result.point.value <= 0.0 or self.idle == IDLE or self.rejected == REJECTED

    def try_step(self) -> bool:
        """Try one step, which moves the point or shrinks the trust region; return whether there was a step to try."""
        compiled, point = self.compiled, self.result.point
        cuts = nearest_to_binding(compiled, point.candidate, point.cuts)
        linear = Linearisation(compiled, point.candidate, cuts)
        first = linear.quadratic_step(self.radius, self.curvature)
        if first is None or self._is_stationary(first, float(first.d[linear.beta])):
            return False
        if self._renew_curvature(linear, cuts, first):
            first = linear.quadratic_step(self.radius, self.curvature)
        step = None if first is None else linear.step(first, self.radius)
        if step is None or compiled.violation(step.candidate) > FEASIBLE:
            self.radius, self.is_stale = CONTRACTION * self.radius, True
        else:
            self._compare(step, cuts)
        return True

    def _is_stationary(self, first: QuadraticStep, predicted: float) -> bool:
        """Return whether a step is to gain nothing, in the solver's unit, and hardly changes the Lagrangian's gradient.

        On a plateau, where directions without torque limit mu, that gradient changes little while steps still gain.
        """
        if self.curvature is None or predicted > STATIONARY * self.result.point.value * self.compiled.scaling.beta:
            return False
        return float(np.max(np.abs(self.curvature @ first.d))) < STATIONARY

    def _renew_curvature(self, linear: Linearisation, cuts: FloatArray, first: QuadraticStep) -> bool:
        """Recompute the Lagrangian's curvature where it is needed; return whether it was recomputed.

        It is recomputed at most every second round, except in the final refinement.
        """
        compiled, point = self.compiled, self.result.point
        predicted = float(first.d[linear.beta])
        self.is_near = self.is_near or predicted < SMALL_GAIN * point.value * compiled.scaling.beta
        renewed = self.is_near and (self.is_stale or self.least == 0.0)
        if renewed:
            minimisers = np.arange(len(cuts)) < len(point.minimisers)
            self.curvature = reduced_hessian(linear, cuts, minimisers, first.multipliers)
        self.is_stale = not renewed if self.is_near else True
        return renewed

    def _compare(self, step: TrustRegionStep, cuts: FloatArray) -> None:
        """Evaluate the candidate of a step, and accept or reject it."""
        compiled, point = self.compiled, self.result.point
        length = float(np.max(np.abs(_differences(compiled, step.candidate, point.candidate))))
        trial = evaluate_candidate(compiled, step.candidate, point.minimisers, self.rng)
        self.is_near = self.is_near or trial.value - point.value < FAIR * step.predicted_gain
        accepted = trial.value >= point.value * (1.0 - NO_LOSS)
        if trial.value >= (1.0 + self.least) * point.value:
            self.idle = 0
        elif accepted or self.least > 0.0:  # the final refinement shortens its steps until one helps
            self.idle += 1
        self.rejected = 0 if accepted else self.rejected + 1
        if accepted:
            self._accept(step, trial, cuts, length)
        else:
            self._reject(trial, length)

    def _accept(self, step: TrustRegionStep, trial: RefinementPoint, cuts: FloatArray, length: float) -> None:
        """Accept a step: move to its candidate and enlarge the trust region; of kept cuts, those that bound it stay."""
        point = self.result.point
        binding = cuts[np.flatnonzero(step.cut_multipliers > ACTIVE)] if len(point.nearby_cuts) else point.nearby_cuts
        binding = binding[new_directions(self.compiled, trial.minimisers, binding)]
        self.radius = min(EXPANSION * self.radius, LARGEST_RADIUS)
        self.result = replace(
            self.result,
            point=replace(trial, nearby_cuts=binding),
            length=length,
            multipliers=step.multipliers,
            history=(*self.result.history, trial.value),
        )

    def _reject(self, trial: RefinementPoint, length: float) -> None:
        """Reject a step: stay, add the rejected candidate's minimisers as cuts, and shrink the trust region."""
        point = self.result.point
        minimisers = np.concatenate([point.minimisers, trial.minimisers])
        corrected = evaluate_candidate(self.compiled, point.candidate, minimisers, self.rng)
        cuts = np.concatenate([trial.minimisers, point.nearby_cuts])
        if corrected.value < (1.0 - MISSED) * self.initial.value:  # descents had overestimated the value
            corrected, cuts = self.initial, np.concatenate([corrected.minimisers, cuts])
        self.radius, self.is_stale = CONTRACTION * min(self.radius, length), True
        self.result = replace(self.result, point=replace(corrected, nearby_cuts=cuts))


def _differences(compiled: CompiledProblem, moved: GraspCandidate, candidate: GraspCandidate) -> FloatArray:
    """Return the difference of two candidates in the program's variables, zero for beta, solver units."""
    program = compiled.cutting_planes.functions.program
    difference = pack_variables(compiled, program, moved) - pack_variables(compiled, program, candidate)
    difference[program.block("beta").range] = 0.0
    return difference
