"""KKT point of the program (3.5-4) near a grasp, with multipliers and residuals.

Newton steps with the reduced Hessian end near a local optimum. From there IPOPT solves the program along the weakest
directions, with the multipliers of the last step as initial ones. The KKT residuals of its solution are computed
independently.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.scalar_constraints import CLEARANCE
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import SUPPORT, CompiledProgram, NlpResult, Program
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, pack_variables
from nlpgrasp.optimize.cutting_planes import (
    append_new,
    cut_parameters,
    directions_around,
    exact_minimisers,
    nearest_to_binding,
    weakest_directions_of,
)
from nlpgrasp.optimize.link_rows import LinkRows
from nlpgrasp.optimize.local_search import RefinementPoint, RefinementResult, advance, evaluate_candidate, go_on
from nlpgrasp.optimize.trust_region import Linearisation
from nlpgrasp.solution.kkt import KKT, kkt_residuals

NEWTON_STEPS = 30  # at most
PROGRAM_ROUNDS, FORCE_ROUNDS = 4, 2  # solves by IPOPT, at most; with finger forces among its variables (seconds each)
RADIUS, LEAST_RADIUS = 10.0, 1e-5  # first trust-region radius over the last step's length; at least, solver units
WIDE = 0.01  # solver units, largest trust-region radius, and that after the first solve
BINDING = 1e-9  # least weight of a binding direction
SLACK = 1e-5  # largest relative slack of binding inequalities: the program smooths the apex of cones
EXCESS = 1e-3  # largest relative excess of beta over the least ratio in all directions
MISSED = "the last steps missed directions in which the grasp is weaker"  # reason why residuals are not small
UNSETTLED = "the last steps did not settle"  # likewise


@dataclass(frozen=True)
class LocalOptimum:
    """Local optimum of the cutting-plane program, with multipliers and KKT residuals.

    Parameters
    ----------
    candidate : GraspCandidate
    value : float
        Least support ratio.
    cuts, weights : (m, d) and (m,) arrays
        Directions with ``phi_A = 1`` and their weights, whose sum is one.
    prices : (rows,) array
        Shadow prices ``d mu / d limit`` of the constraints, in their own units.
    bounds : dict
        ``d mu / d bound`` of the hand's variables by name: positive where the upper bound binds, negative the lower.
    link_prices : (rows,) array
        Likewise of the clearances of links that the program holds, a metre.
    link_rows : LinkRows or None
        These clearances; None for hands without links.
    kkt : KKT
        Residuals of the program along the cuts.
    effort : SolverEffort
        Of IPOPT.
    """

    candidate: GraspCandidate
    value: float
    cuts: FloatArray
    weights: FloatArray
    prices: FloatArray
    bounds: dict[str, FloatArray]
    link_prices: FloatArray
    link_rows: LinkRows | None
    kkt: KKT
    effort: SolverEffort


def find_local_optimum(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline, known: FloatArray | None = None
) -> LocalOptimum | None:
    """Return the local optimum near a candidate; large residuals tell that the solve did not converge.

    Descents, also from known directions (m, d), give the weakest directions; only a certificate of the optimum can show
    that they missed one.

    None for a candidate that does not exert the task, and under a hand's torque limits, which the program does not
    hold.
    """
    return optimum_near(compiled, advance(compiled, candidate, deadline, 0, known=known), deadline)


def optimum_near(compiled: CompiledProblem, refined: RefinementResult, deadline: Deadline) -> LocalOptimum | None:
    """Return the local optimum near the result of a local search, as ``find_local_optimum`` does.

    Under joint-torque limits there are no Newton steps: the support has kinks at most local optima.
    """
    budget = compiled.problem.budget
    if budget.follows_hand:
        return None
    radius = LEAST_RADIUS
    if not budget.depends_on_frames:
        refined = go_on(
            compiled,
            refined,
            deadline,
            NEWTON_STEPS,
            lambda point: point_with_multipliers(compiled, point).kkt.is_small,
        )
        radius = min(max(LEAST_RADIUS, RADIUS * refined.length), WIDE)
    if refined.point.value <= 0.0:
        return None
    if budget.has_kinks:  # at which a program along fixed directions is loose
        return point_with_multipliers(compiled, refined.point)
    return _solve_program(compiled, refined.point, radius, np.random.default_rng(0), deadline)


def reason_against_optimum(compiled: CompiledProblem) -> str:
    """Return why the problem or its options rule out a local optimum, as text; empty if they do not."""
    if compiled.options.maximise_robust:
        return "the contacts are where the worst placement is best, not where mu is"
    if not compiled.options.rounds:
        return "the search was asked not to refine contacts (rounds=0)"
    if compiled.problem.budget.follows_hand:
        return "the program along directions does not hold the torques of a hand's joints"
    return ""


def residuals_at(compiled: CompiledProblem, candidate: GraspCandidate) -> KKT:
    """Return the KKT residuals at a candidate, with least-squares multipliers."""
    rng = np.random.default_rng(0)
    directions = weakest_directions_of(compiled, candidate, rng).directions
    return point_with_multipliers(compiled, evaluate_candidate(compiled, candidate, directions, rng)).kkt


def _solve_program(
    compiled: CompiledProblem, point: RefinementPoint, radius: float, rng: np.random.Generator, deadline: Deadline
) -> LocalOptimum:
    """Return the best of repeated IPOPT solves from a point, by KKT residuals.

    Each solve adds weak directions of the last solution, until residuals are small. Where the first solve does not
    confirm the point, the multipliers of a Newton step may. They come first where finger forces are among IPOPT's
    variables, since it knows neither multipliers nor forces, and with a hand's pose, with which IPOPT takes longer.
    """
    planes, refined = compiled.cutting_planes, point
    newton_first = not (planes.holds_supports and compiled.follows_contacts)
    cuts, effort, solutions = point.minimisers, SolverEffort(), list[LocalOptimum]()
    rounds = PROGRAM_ROUNDS if planes.holds_supports else FORCE_ROUNDS
    for number in range(rounds if compiled.follows_contacts else 1):
        if number == int(not newton_first):
            solutions.append(point_with_multipliers(compiled, refined))
            if solutions[-1].kkt.is_small:
                break
        cuts = nearest_to_binding(compiled, point.candidate, cuts, planes.final_slots)
        is_confirming = planes.holds_supports and not number
        functions = planes.confirmation_program if is_confirming else planes.final_program
        optimum = _solve_in_trust_region(compiled, functions, point, cuts, radius, rng)
        solutions.append(optimum)
        effort += optimum.effort
        if deadline.should_stop() or optimum.kkt.is_small:
            break
        cuts = append_new(compiled, cuts, exact_minimisers(compiled, optimum.candidate, rng, cuts).directions)
        if optimum.value > point.value:
            point = replace(point, candidate=optimum.candidate, value=optimum.value)
        radius = WIDE
    return replace(min(solutions, key=lambda optimum: optimum.kkt.largest), effort=effort)


def point_with_multipliers(compiled: CompiledProblem, point: RefinementPoint) -> LocalOptimum:
    """Return a point of a local search with its least-squares multipliers and KKT residuals.

    Beside the minimisers of the support ratio, directions close to these bind as well.
    """
    cuts = directions_around(compiled, point.candidate, point.minimisers)
    cuts = nearest_to_binding(compiled, point.candidate, cuts, compiled.cutting_planes.final_slots)
    linear = Linearisation(compiled, point.candidate, cuts)
    multipliers, bound_multipliers = linear.least_squares_multipliers()
    optimum = LocalOptimum(
        point.candidate,
        point.value,
        cuts,
        _normalised_weights(linear.cut_multipliers(multipliers)),
        *_shadow_prices(compiled, linear.functions.program, multipliers, bound_multipliers),
        _linearised_residuals(linear, multipliers, bound_multipliers),
        SolverEffort(),
    )
    return replace(optimum, kkt=_full_kkt(compiled, optimum, float(linear.z[linear.beta]) / compiled.scaling.beta))


def _solve_in_trust_region(
    compiled: CompiledProblem,
    functions: CompiledProgram,
    point: RefinementPoint,
    cuts: FloatArray,
    radius: float,
    rng: np.random.Generator,
) -> LocalOptimum:
    """Return IPOPT's solution inside a trust region around a point."""
    faces, program, scale = point.candidate.faces, functions.program, compiled.scaling.beta
    z = pack_variables(compiled, program, point.candidate)
    theta = cut_parameters(compiled, point.candidate, cuts, compiled.cutting_planes.final_slots)
    z[program.block("beta").range] = scale * min(
        point.value, float(np.min(compiled.wrench_set(point.candidate).support(cuts)[0]))
    )
    result = functions.solve(
        z, theta, program.trust_region_bounds(z, radius), _initial_multipliers(compiled, point, cuts, radius)
    )
    candidate = candidate_of(compiled, program, faces, result.z)
    optimum = LocalOptimum(
        candidate,
        exact_minimisers(compiled, candidate, rng, cuts).value,
        cuts,
        _normalised_weights(-result.multipliers[program.constraint_indices(SUPPORT)][: len(cuts)]),
        *_shadow_prices(compiled, program, result.multipliers, result.bound_multipliers),
        _residuals(functions, result, theta),
        SolverEffort.of(result),
    )
    return replace(optimum, kkt=_full_kkt(compiled, optimum, result.objective / scale))


def _normalised_weights(multipliers: FloatArray) -> FloatArray:
    """Return weights (m,) of sum one, in proportion to the multipliers of cuts; zero if all multipliers are."""
    weights = np.maximum(multipliers, 0.0)
    return np.asarray(weights / max(float(weights.sum()), 1e-300))


def _shadow_prices(
    compiled: CompiledProblem, program: Program, multipliers: FloatArray, bound_multipliers: FloatArray
) -> tuple[FloatArray, dict[str, FloatArray], FloatArray, LinkRows | None]:
    """Return the shadow prices of constraints, of the hand's bounds and of clearances of links, in their own units."""
    scale, scales = compiled.scaling.beta, np.array([constraint.scale for constraint in compiled.rows.named])
    bounds = {name: bound_multipliers[b.range] / (scale * b.scale) for name, b in program.hand_blocks}
    links = multipliers[program.constraint_indices(CLEARANCE)] / (scale * compiled.problem.body.size)
    return multipliers[program.placement] / (scale * scales), bounds, links, compiled.link_rows


def _full_kkt(compiled: CompiledProblem, optimum: LocalOptimum, beta: float) -> KKT:
    """Return the KKT residuals of an optimum, including the support inequalities in all directions.

    Feasibility requires beta close to the least ratio over all directions. Complementarity is that of the inequalities.
    """
    kkt = _with_binding_directions(optimum.kkt, optimum.cuts, optimum.weights)
    slack = compiled.wrench_set(optimum.candidate).support(optimum.cuts)[0] - beta
    slack_error = float(np.max(optimum.weights * np.abs(slack), initial=0.0)) / max(abs(beta), 1e-300)
    excess = (beta - optimum.value) / max(abs(beta), 1e-300)
    return replace(
        kkt,
        feasibility=kkt.feasibility if excess <= EXCESS else max(kkt.feasibility, excess),
        complementarity=kkt.complementarity if slack_error <= SLACK else max(kkt.complementarity, slack_error),
    )


def _with_binding_directions(kkt: KKT, cuts: FloatArray, weights: FloatArray) -> KKT:
    """Return KKT residuals with the binding directions among cuts (m, d) and their weights added."""
    binding = weights > BINDING
    directions = tuple(tuple(map(float, direction)) for direction in cuts[binding])
    return replace(kkt, directions=directions, weights=tuple(weights[binding].tolist()))


def _initial_multipliers(
    compiled: CompiledProblem, point: RefinementPoint, cuts: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return multipliers of constraints and bounds from the linearised program at a point; None without a step."""
    if not compiled.cutting_planes.holds_supports:
        return None
    step = Linearisation(compiled, point.candidate, cuts).quadratic_step(radius)
    return None if step is None else (step.multipliers, step.bound_multipliers)


def _linearised_residuals(linear: Linearisation, multipliers: FloatArray, bound_multipliers: FloatArray) -> KKT:
    """Return the KKT residuals at a linearisation's point with given multipliers."""
    rows = linear.rows
    constraints = rows.values, rows.lower, rows.upper
    bounds = linear.functions.program.bounds
    return _kkt(linear.z, linear.beta, rows.jacobian, constraints, bounds, (multipliers, bound_multipliers))


def _residuals(functions: CompiledProgram, result: NlpResult, theta: FloatArray) -> KKT:
    """Return the KKT residuals of IPOPT's solution in the program without a trust region."""
    program = functions.program
    values, jacobian = functions.linearise(result.z, theta)
    multipliers = result.multipliers, result.bound_multipliers
    beta = program.block("beta").start
    return _kkt(result.z, beta, jacobian, (values, *program.limits), program.bounds, multipliers)


def _kkt(
    z: FloatArray,
    beta: int,
    jacobian: FloatArray,
    constraints: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    multipliers: tuple[FloatArray, FloatArray],
) -> KKT:
    """Return the KKT residuals at variables (n,), solver units, with the objective divided by the size of beta."""
    size = max(abs(float(z[beta])), 1e-300)
    gradient = np.zeros(len(z))
    gradient[beta] = 1.0 / size
    constraint_multipliers, bound_multipliers = (values / size for values in multipliers)
    return KKT(*kkt_residuals(gradient, jacobian, constraints, (z, *bounds), constraint_multipliers, bound_multipliers))
