"""Infeasibility diagnosis: contradicting constraints, or a task wrench that the fingers cannot exert.

Elastic relaxation: every group of constraints (one of the user's, the fingertips, the links' clearance) may be broken
at a price, and the sum of the groups' largest violations is minimised from several starts, by quadratic programs in a
trust region. What is left is a least violated set: locally, so the status is locally infeasible, never more.

Where the constraints can be kept, the diagnosis names a wrench that the best grasp found cannot exert, and the larger
friction with which it could.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.analysis.jaw_diagnosis import jaw_reasons
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.formatting import format_wrench_direction
from nlpgrasp.common.quadratic_program import GroupSlack, Linearised, quadratic_step, step_bounds
from nlpgrasp.common.scalar_constraints import (
    CLEARANCE,
    CLOSED_LINKAGE,
    ON_FINGERTIP,
    UNIT_QUATERNION,
    ScalarConstraint,
)
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Obstacle, Table
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, pack_variables
from nlpgrasp.optimize.cutting_planes import parameters_without_cuts
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.start import run_start
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.quality import mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.analysis_records import Conflict, WhyNot

STARTS, STEPS = 6, 40  # starts of the relaxation; steps of each, at most
FIRST_RADIUS, LAST_RADIUS = 0.3, 1e-3  # trust-region radius, solver units
LEAST_GAIN = 1e-4  # relative: a step that gains less is rejected
DAMPING = 1e-3  # weight of the squared step
FINGERTIPS = "fingertips on the body"  # group of the constraints between fingertips and contacts
HARD = "the body's surface"  # group of the constraints that are never relaxed
# of constraints that are not called as their kind
HAND_GROUPS = {ON_FINGERTIP: FINGERTIPS, UNIT_QUATERNION: HARD, CLOSED_LINKAGE: HARD}
HARD_WEIGHT = 100.0  # of the violation of the hard group; 1 of the others
VIOLATION_TOLERANCE = 1e-4  # relative to a constraint's scale: smaller violations count as none
FACTORS = (1.1, 1.25, 1.5, 2.0, 3.0)  # of friction, with which the best grasp is tried


def diagnose_on_one_thread(
    compiled: CompiledProblem, results: Sequence[StartResult], seed: int, deadline: Deadline
) -> WhyNot | None:
    """Return the infeasibility diagnosis, computed on one thread; None if it fails numerically."""
    with single_thread():
        return attempt(lambda: diagnose(compiled, results, seed, deadline))[0]


def diagnose(compiled: CompiledProblem, results: Sequence[StartResult], seed: int, deadline: Deadline) -> WhyNot:
    """Return the infeasibility diagnosis of a problem whose starts found no grasp."""
    floor, kept = compiled.problem.least_mu, (r for r in results if isinstance(r, StartGrasp) and r.on_body.is_feasible)
    reached = max((result.record.mu.upper for result in kept), default=0.0)
    if floor is not None and reached > 0.0:
        reason = f"GraspProblem.least_mu is {floor:.4g}; the largest mu that the starts found is {reached:.4g}."
        return WhyNot(reasons=(reason,), advice=("A lower least_mu, more friction or further contacts may do.",))
    least_violated: RelaxationResult | None = None
    for index in range(STARTS):
        if deadline.should_stop():
            break
        candidate = propose(compiled, np.random.default_rng([seed, index, 1]))[0]
        relaxed = minimise_violation(compiled, candidate)
        if least_violated is None or relaxed.total < least_violated.total:
            least_violated = relaxed
        if least_violated.total <= VIOLATION_TOLERANCE:
            break
    if least_violated is None:
        return WhyNot(reasons=("Stopped before a reason was found.",))
    if least_violated.total > VIOLATION_TOLERANCE:
        diagnosis = _contradiction(compiled, least_violated)
    else:
        diagnosis = _explain_unreachable(compiled, results)
    # what blocks pads and fingers is not why the contacts do not exert a wrench
    if reasons := jaw_reasons(compiled.problem, with_solids=diagnosis.direction is None):
        return replace(diagnosis, reasons=reasons, advice=())
    named = {conflict.name for conflict in diagnosis.conflicts}
    return replace(diagnosis, reasons=(*diagnosis.reasons, *surroundings_in_the_way(compiled, named, seed, deadline)))


def surroundings_in_the_way(
    compiled: CompiledProblem, named: Collection[str], seed: int, deadline: Deadline
) -> Iterator[str]:
    """Yield, as text, each table and obstacle without which a start finds a grasp.

    The text states by how much that grasp violates the clearance from it. Those that are ``named`` among the conflicts
    are left out.
    """
    problem, groups = compiled.problem, group_names(compiled)
    for i, constraint in enumerate(problem.constraints):
        indices = list(compiled.rows.sources[i])
        if not isinstance(constraint, Table | Obstacle) or not indices or groups[indices[0]] in named:
            continue
        if deadline.should_stop():
            return
        others = tuple(other for other in problem.constraints if other is not constraint)
        start = run_start(CompiledProblem(problem.unchecked(constraints=others), compiled.options), 0, seed, deadline)
        if isinstance(start, StartGrasp) and start.record.has_grasp:
            grasp, hand = start.on_body.grasp, start.on_body.candidate.hand
            stacked = {name: value[None] for name, value in hand.items()}
            values = compiled.rows.values(grasp.points[None], grasp.normals[None], stacked)[0, indices]
            room = max(compiled.rows.named[index].lower - value for index, value in zip(indices, values, strict=True))
            name = f"the {groups[indices[0]]}" if isinstance(constraint, Table) else groups[indices[0]]
            yield f"Without {name} a start finds a grasp, which takes {1e3 * room:.2g} mm more room there."


def _contradiction(compiled: CompiledProblem, relaxed: RelaxationResult) -> WhyNot:
    """Return the diagnosis of constraints that no start could satisfy together.

    Its conflicts are the largest violations at the candidate of least violation.
    """
    conflicts = [
        make_conflict(name, compiled.rows.named[index], value) for name, (_, index, value) in relaxed.worst.items()
    ]
    conflicts.sort(key=lambda c: -c.excess)
    constraints = sorted(set(group_names(compiled)) - {HARD})
    names = ", ".join(c.name for c in conflicts)
    reasons = [
        *([f"From no start could all of these be kept at once: {', '.join(constraints)}."] if constraints else []),
        f"The nearest miss breaks: {names}." if conflicts else "The contacts do not stay on their faces.",
        *(str(c) for c in conflicts),
    ]
    fixed = {FINGERTIPS, CLEARANCE}
    advice = [f"Relax {c.name} by at least {c.amount}." for c in conflicts if c.name not in fixed]
    if any(c.name in fixed for c in conflicts):
        advice.append("Try a hand of another size, fewer contacts, or less in its way.")
    return WhyNot(tuple(conflicts), None, tuple(reasons), tuple(advice), locally_infeasible=True)


def _explain_unreachable(compiled: CompiledProblem, results: Sequence[StartResult]) -> WhyNot:
    """Return the diagnosis of a problem whose constraints can be satisfied but whose task cannot be exerted."""
    grasps = [r.on_body.grasp for r in results if isinstance(r, StartGrasp)]
    if not grasps:
        return WhyNot(reasons=("The constraints can be kept, but every start ended with an error.",))
    task, budget = compiled.problem.task, compiled.closure_budget
    bounds = [mu(g, task, 0.1, force_budget=budget) for g in grasps]
    best = int(np.argmax([b.upper for b in bounds]))
    grasp, interval = grasps[best], bounds[best]
    if interval.lower > 0.0:
        reason = "The constraints can be kept and the task's wrenches can be exerted, but no start did both at once."
        return WhyNot(reasons=(reason,), advice=("Try more starts.",))
    direction = interval.worst_direction
    reasons = ["The constraints can be kept, but in the best grasp found the fingers cannot exert one wrench."]
    if direction is not None:
        reasons.append(f"That wrench is {format_wrench_direction(direction, compiled.scaling.length)}.")
    advice = _friction_advice(compiled, grasp)
    advice.append("Try more starts, more fingers, other faces, or soft contacts where a torque is what is missing.")
    return WhyNot((), direction, tuple(reasons), tuple(advice))


def _friction_advice(compiled: CompiledProblem, grasp: Grasp) -> list[str]:
    """Return the least factor on friction with which a grasp exerts the task, as advice; an empty list if none does.

    Only ``FACTORS`` are tried.
    """
    for factor in FACTORS:
        if not all("friction" in model.coefficients for model in grasp.contacts):
            break
        models = [m.with_coefficients(friction=factor * m.coefficients["friction"]) for m in grasp.contacts]
        rougher = Grasp(grasp.points, grasp.normals, models, grasp.torque_origin)
        if mu(rougher, compiled.problem.task, 0.5, force_budget=compiled.closure_budget).lower > 0.0:
            return [f"With friction {factor:g} times as large the best grasp found would exert the task's wrenches."]
    return []


@dataclass(frozen=True)
class RelaxationResult:
    """Result of an elastic relaxation: the least constraint violations.

    Parameters
    ----------
    total : float
        Sum of the groups' largest violations, relative to the constraints' scales.
    worst : dict
        Largest violation of each group, with index and value of its scalar constraint.
    """

    total: float
    worst: dict[str, tuple[float, int, float]]


def minimise_violation(compiled: CompiledProblem, candidate: GraspCandidate) -> RelaxationResult:
    """Return the least constraint violations near a candidate, by a trust-region method."""
    relaxation = _Relaxation(compiled, candidate)
    iterate = relaxation.at(pack_variables(compiled, relaxation.functions.program, candidate))
    radius = FIRST_RADIUS
    for _ in range(STEPS):
        if iterate.merit <= 0.1 * VIOLATION_TOLERANCE or radius < LAST_RADIUS:
            break
        trial = relaxation.step(iterate, radius)
        if trial is None:
            radius *= 0.3
        elif trial.merit < iterate.merit * (1.0 - LEAST_GAIN):
            iterate, radius = trial, min(1.5 * radius, FIRST_RADIUS)
        else:
            radius *= 0.4
    return relaxation.worst_violations(iterate)


class _Relaxation:
    """Elastic relaxation of the constraints, with a penalty on the largest violation in each group."""

    def __init__(self, compiled: CompiledProblem, candidate: GraspCandidate) -> None:
        self.compiled, self.functions = compiled, compiled.cutting_planes.functions
        program = self.functions.program
        self.theta = parameters_without_cuts(compiled, candidate)
        self.used = slice(program.contained, None)
        self.offset = program.placement.start - program.contained
        self.low, self.high = (limits[self.used] for limits in program.limits)
        groups = _constraint_groups(compiled, len(self.low), self.offset)
        self.names = sorted(set(groups))
        member = np.array([self.names.index(g) for g in groups])
        self.slack = GroupSlack(member, np.array([HARD_WEIGHT if name == HARD else 1.0 for name in self.names]))

    def at(self, z: FloatArray) -> _RelaxationIterate:
        """Return the iterate at given variables of the program."""
        g, J = self.functions.linearise(z, self.theta)
        largest = np.zeros(len(self.names))
        np.maximum.at(largest, self.slack.member, self.violations(g[self.used]))
        return _RelaxationIterate(z, g[self.used], J[self.used], largest, float(self.slack.weights @ largest))

    def violations(self, values: FloatArray) -> FloatArray:
        """Return the violation of each scalar constraint."""
        excess = np.maximum(np.maximum(self.low - values, values - self.high), 0.0)
        return np.where(np.isnan(values), np.inf, excess)

    def step(self, iterate: _RelaxationIterate, radius: float) -> _RelaxationIterate | None:
        """Return the next iterate, by the step of least weighted violation; None if the solver finds none."""
        bounds = step_bounds(iterate.z, self.functions.program.bounds, radius)
        linearised = Linearised(iterate.values, iterate.jacobian, self.low, self.high, *bounds)
        solution = quadratic_step(linearised, damping=DAMPING, slack=self.slack)
        return None if solution is None else self.at(iterate.z + solution.d)

    def worst_violations(self, iterate: _RelaxationIterate) -> RelaxationResult:
        """Return the worst remaining violation in each group of constraints."""
        violations, worst = self.violations(iterate.values), {}
        for i, name in enumerate(self.names):
            members = np.flatnonzero(self.slack.member == i)
            entry = int(members[np.argmax(violations[members])])
            if violations[entry] > VIOLATION_TOLERANCE and name != HARD:
                constraint_index = entry - self.offset
                scale = self.compiled.rows.named[constraint_index].scale
                worst[name] = (float(violations[entry]), constraint_index, float(iterate.values[entry] * scale))
        return RelaxationResult(float(np.sum(iterate.largest)), worst)


@dataclass(frozen=True)
class _RelaxationIterate:
    """Iterate of the elastic relaxation, with constraint values, Jacobian and merit.

    The merit is the weighted sum of the groups' largest violations.
    """

    z: FloatArray
    values: FloatArray
    jacobian: FloatArray
    largest: FloatArray
    merit: float


def group_names(compiled: CompiledProblem) -> list[str]:
    """Return the group name of each scalar constraint of the placement.

    A group is one constraint of the user's, or all of the hand's constraints of one kind. It has the name of its kind;
    several constraints of one kind are numbered in the order of ``GraspProblem.constraints``.
    """
    constraints, sources = compiled.rows.named, compiled.rows.sources
    count = len(compiled.problem.constraints)
    kinds = [constraints[source[0]].kind if source else "" for source in sources[:count]]
    names = [""] * len(constraints)
    for i, source in enumerate(sources):
        for index in source:
            if i >= count:
                names[index] = HAND_GROUPS.get(constraints[index].kind, constraints[index].kind)
            else:
                ordinal = kinds[: i + 1].count(kinds[i])
                names[index] = kinds[i] if kinds.count(kinds[i]) == 1 else f"{kinds[i]} ({ordinal})"
    return names


def _constraint_groups(compiled: CompiledProblem, count: int, offset: int) -> list[str]:
    """Return the group names of the program's scalar constraints, without those of task containment.

    There are ``count``. Those of the placement begin at ``offset``; the others, such as the faces', are ``HARD``.
    """
    names = group_names(compiled)
    return [HARD] * offset + names + [HARD] * (count - offset - len(names))


def make_conflict(name: str, constraint: ScalarConstraint, value: float) -> Conflict:
    """Return the conflict record of a violated scalar constraint.

    Squared lengths become metres. Cosines become degrees, which reverses the relation.
    """
    is_below = value < constraint.lower
    bound = constraint.lower if is_below else constraint.upper
    relation = "exactly" if constraint.lower == constraint.upper else "at least" if is_below else "at most"
    if constraint.unit == "m2":
        value, bound = float(np.sqrt(max(value, 0.0))), float(np.sqrt(max(bound, 0.0)))
    if constraint.unit == "cos":
        value, bound = (float(np.degrees(np.arccos(np.clip(c, -1.0, 1.0)))) for c in (value, bound))
        relation = {"at least": "at most", "at most": "at least"}.get(relation, relation)
    return Conflict(
        name,
        constraint.name,
        value,
        bound,
        relation,
        {"m2": "m", "cos": "degrees"}.get(constraint.unit, constraint.unit),
    )
