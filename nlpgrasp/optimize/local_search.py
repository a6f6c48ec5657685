"""Local search: maximisation of mu by cutting planes in a trust region.

The support inequalities (Li and Sastry 1986, equation 3.4-3) hold in the directions where the current grasp is weakest.
A step maximises beta in the linearised program plus the curvature of its Lagrangian; contacts and hand return to the
constraints, are weakest in other directions there, and so on until no step helps. Where forces are variables of the
program, IPOPT solves it inside the trust region instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import Effort, GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem, pack_variables
from nlpgrasp.optimize.cutting_planes import find_weaker, minimise_nearby, most_relevant, weakest_at
from nlpgrasp.optimize.trust_region import ACTIVE, Linearisation, program_step, reduced_hessian
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.weakest_directions import MISSED

LOOKS = 4  # certificates that look for directions missed by descents, at most
RADIUS, MOST_RADIUS = 0.03, 0.1  # trust-region radius, first and most, over the body's size
LONGER, SHORTER = 1.5, 0.4  # factors of the trust-region radius after a step that is accepted, and rejected
SETTLED = 1e-7  # solver units, change of the Lagrangian's gradient over a step at which refinement ends
NO_LOSS = 1e-9  # relative decrease that still counts as none
NEAR = 0.02  # predicted relative gain of a step without curvature below which curvature is used
LEAST_GAIN, IDLE = 1e-4, 2  # relative gain below which a round is idle; idle rounds in a row that end a refinement
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
    others : (m', d) array
        Directions in which places nearby are weaker.
    """

    candidate: GraspCandidate
    value: float
    minimisers: FloatArray
    others: FloatArray

    @property
    def cuts(self) -> FloatArray:
        """All directions, (m + m', d)."""
        return np.concatenate([self.minimisers, self.others])


@dataclass(frozen=True)
class RefinementResult:
    """Result of a refinement.

    Parameters
    ----------
    point : RefinementPoint
    length : float
        Of the last step, solver units.
    multipliers : (rows,) array
        Of the rows of constraints and hand in the last step, solver units.
    history : tuple of float
        The least ratio at first and after each step.
    effort : Effort
        Of IPOPT.
    certificate : ResumableCertificate or None
        Of the point, as far as it told that descents missed nothing.
    """

    point: RefinementPoint
    length: float
    multipliers: FloatArray
    history: tuple[float, ...] = ()
    effort: Effort = field(default_factory=Effort)
    certificate: ResumableCertificate | None = None

    def state(self) -> SearchState:
        """Return the result as the state of a local search."""
        point = self.point
        return SearchState(point.candidate, point.value, point.cuts, self.multipliers, self.effort, list(self.history))


def evaluate_candidate(
    compiled: CompiledProblem, candidate: GraspCandidate, known: FloatArray, rng: np.random.Generator
) -> RefinementPoint:
    """Return a candidate with its weakest directions, searched from known ones (m, d) as well."""
    found = minimise_nearby(compiled, candidate, rng, known)
    return RefinementPoint(candidate, found.value, found.directions, found.directions[:0])


def refine(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    deadline: Deadline,
    rounds: int | None = None,
    least: float = LEAST_GAIN,
) -> RefinementResult:
    """Return the local optimum reached from a candidate within some rounds; itself where it does not exert the task.

    Rounds end where two in a row gain less than a share ``least``, or where the Lagrangian is flat. Descents may
    flatter: a polytope looks for directions that they missed, and the search goes on with these, from where it began if
    it was led astray.
    """
    rng, rounds = np.random.default_rng(0), compiled.options.rounds if rounds is None else rounds
    sure = refined = _begun(compiled, candidate, rng)
    for _ in range(LOOKS):
        refined = _iterate_steps(compiled, refined, rng, deadline, rounds, least)
        here = refined.point
        missed, begun = find_weaker(compiled, here.candidate, here.value)
        if missed is None:
            return replace(refined, certificate=begun)
        again = evaluate_candidate(compiled, here.candidate, np.concatenate([missed.directions, here.minimisers]), rng)
        value = min(again.value, missed.value)
        if value > sure.point.value:
            sure = refined = replace(refined, point=replace(again, value=value, others=here.others))
        else:
            others = np.concatenate([missed.directions, sure.point.others])
            sure = refined = replace(sure, point=replace(sure.point, others=others), effort=refined.effort)
        if deadline.is_requested():
            break
    return sure


def advance(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline, rounds: int) -> RefinementResult:
    """Return a candidate after a few rounds of refinement, by whose values candidates can be compared.

    No certificate has looked for directions in which it is weaker.
    """
    rng, rounds = np.random.default_rng(0), min(rounds, compiled.options.rounds)
    return _iterate_steps(compiled, _begun(compiled, candidate, rng), rng, deadline, rounds, LEAST_GAIN)


def _begun(compiled: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator) -> RefinementResult:
    """Return a candidate as the beginning of a refinement."""
    here = evaluate_candidate(compiled, candidate, weakest_at(compiled, candidate, rng).directions, rng)
    return RefinementResult(here, RADIUS, np.zeros(len(compiled.rows.named)), (here.value,))


def _iterate_steps(
    compiled: CompiledProblem,
    refined: RefinementResult,
    rng: np.random.Generator,
    deadline: Deadline,
    rounds: int,
    least: float,
) -> RefinementResult:
    """Return the point at which no trust-region step improves any more."""
    begun = here = refined.point
    radius, curvature, near, stale, idle = RADIUS, None, least == 0.0, True, 0
    for _ in range(rounds):
        if deadline.is_requested() or here.value <= 0.0 or idle == IDLE:
            return refined
        cuts = most_relevant(compiled, here.candidate, here.cuts)
        if compiled.cutting_planes.linearises:
            linear = Linearisation(compiled, here.candidate, cuts)
            first = linear.quadratic_step(radius, curvature)
            if first is None or (curvature is not None and float(np.max(np.abs(curvature @ first.d))) < SETTLED):
                return refined
            near = near or float(first.d[linear.beta]) < NEAR * here.value * compiled.scaling.beta
            stale = stale or least == 0.0
            if near and stale:
                known = np.arange(len(cuts)) < len(here.minimisers)
                curvature = reduced_hessian(linear, cuts, known, first.multipliers)
                first = linear.quadratic_step(radius, curvature)
            stale = not stale if near else True
            step = None if first is None else linear.step(first, radius)
        else:
            step = program_step(compiled, here.candidate, here.value, cuts, radius)
        if step is None or compiled.violation(step.candidate) > FEASIBLE:
            radius, stale = SHORTER * radius, True
            continue
        moved = float(np.max(np.abs(_differences(compiled, step.candidate, here.candidate))))
        refined = replace(refined, effort=refined.effort + step.effort)
        there = evaluate_candidate(compiled, step.candidate, here.minimisers, rng)
        near = near or there.value - here.value < FAIR * step.promised
        accepted = there.value >= here.value * (1.0 - NO_LOSS)
        if there.value >= (1.0 + least) * here.value:
            idle = 0
        elif accepted or least > 0.0:  # the last step shortens its steps until one helps
            idle += 1
        if accepted:
            binding = cuts[np.flatnonzero(step.support > ACTIVE)] if len(here.others) else here.others
            here, radius = replace(there, others=binding), min(LONGER * radius, MOST_RADIUS)
            history = (*refined.history, here.value)
            refined = replace(refined, point=here, length=moved, multipliers=step.multipliers, history=history)
        else:
            again = evaluate_candidate(
                compiled, here.candidate, np.concatenate([here.minimisers, there.minimisers]), rng
            )
            others = np.concatenate([there.minimisers, here.others])
            if again.value < (1.0 - MISSED) * begun.value:  # descents had flattered it
                again, others = begun, np.concatenate([again.minimisers, others])
            here = replace(again, others=others)
            radius, stale = SHORTER * min(radius, moved), True
            refined = replace(refined, point=here)
    return refined


def _differences(compiled: CompiledProblem, there: GraspCandidate, here: GraspCandidate) -> FloatArray:
    """Return the difference of two candidates in the program's variables but beta and forces, solver units."""
    program = compiled.cutting_planes.functions.program
    moved = pack_variables(compiled, program, there) - pack_variables(compiled, program, here)
    moved[program.block("beta").range] = 0.0
    return moved
