"""Shadow prices: what a little more of each limit would buy in mu.

At a local optimum with multipliers lambda of the rows ``g <= limit`` of the program that maximises beta, the
optimum moves with a parameter t by ``sum lambda d(limit - g) / dt`` (the envelope theorem). Rows of containment
count by the support ratio's own derivative: ``sum a_j d(phi_j / phi_A) / dt`` with weights a_j of sum one.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import URDFHand
from nlpgrasp.nlp import NlpResult, Program
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import collected, given_rows, placement_of
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solution.findings import ShadowPrice
from nlpgrasp.solve.after.limits import Limit, limits_of
from nlpgrasp.solve.ascent.nonlinear import (
    contacts_of,
    evaluated,
    most_relevant,
    new_directions,
    trust_region,
)
from nlpgrasp.solve.ascent.state import ExchangeState
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.start.result import StartResult
from nlpgrasp.solve.workbench.workbench import SLOTS, Workbench
from nlpgrasp.solve.workers.stop import Stop

ROUNDS, ROUNDS_WITH_FORCES, RADIUS = 25, 6, 0.05  # of the last solves; trust region over the body's size
CONVERGED = 3e-5  # relative: the model promises no more than this over what is there
ALLOWED = 1e-4  # violation, relative to the rows' scales: what IPOPT's tolerance and the way back to the faces leave
NOTHING = 1e-4  # relative gains below this are none


@dataclass(frozen=True)
class Optimum:
    """A converged solve of the exchange's program.

    Parameters
    ----------
    points : (k, space) array
    hand : dict
    value : float
        The least support ratio.
    cuts, weights : (m, d) and (m,) arrays
        Directions with ``phi_A = 1`` and their weights, which add up to one.
    prices : (rows,) array
        ``d mu / d limit`` of the rows of constraints and hand, in the rows' own units.
    bounds : dict
        ``d mu / d bound`` of the hand's variables by name: positive where the upper bound binds, negative the lower.
    """

    points: FloatArray
    hand: dict[str, FloatArray]
    value: float
    cuts: FloatArray
    weights: FloatArray
    prices: FloatArray
    bounds: dict[str, FloatArray]


def shadow_prices(bench: Workbench, best: StartResult, stop: Stop) -> tuple[ShadowPrice, ...]:
    """Return the prices of all limits of constraints, hand and contacts, the dearest first.

    None where the last solves do not converge, for a grasp that was cut short, and under a hand's torque limits,
    whose derivatives the program does not hold.
    """
    if best.grasp is None or bench.problem.budget.follows_hand:
        return ()
    points = bench.snap(best.record.faces, best.grasp.points)
    optimum = polished(bench, best.record.faces, points, best.hand or {}, stop)
    if optimum is None:
        return ()
    found = [_price(bench, best.record.faces, optimum, limit) for limit in limits_of(bench.problem)]
    prices = [price for price in found if price is not None] + _joint_prices(bench, optimum)
    prices = [p for p in prices if abs(p.gain) > NOTHING * optimum.value]
    return tuple(sorted(prices, key=lambda p: -abs(p.gain)))


def polished(
    bench: Workbench, faces: tuple[str, ...], points: FloatArray, hand: dict[str, FloatArray], stop: Stop
) -> Optimum | None:
    """Return the local optimum near a grasp with its multipliers, or None where the exchange does not settle."""
    compiled = bench.cut_program(faces)
    program, task = compiled.program, bench.problem.task
    rng = np.random.default_rng(0)
    state = ExchangeState(points, 0.0, hand)
    grasp = bench.grasp(faces, points)
    found = weakest_directions(grasp, task, np.zeros((0, task.dimension)), rng, bench.budget(points, hand))
    state.value, cuts, radius = found.value, found.directions, RADIUS
    for _ in range(ROUNDS if bench.slots == SLOTS else ROUNDS_WITH_FORCES):
        if stop.requested() or state.value <= 0.0:
            return None
        cuts = most_relevant(bench, faces, state, cuts)
        result = compiled.solve(*trust_region(bench, compiled, faces, state, cuts, radius))
        trial, moved = contacts_of(bench, compiled, faces, result.z)
        there = evaluated(bench, faces, trial, moved, cuts, rng, ALLOWED)
        if there is None:
            radius *= 0.3
            continue
        promised = result.objective / bench.scaling.beta
        seen = bench.wrench_set(faces, state.points, state.hand).support(there.directions)[0]
        state.value = min(state.value, float(np.min(seen, initial=np.inf)))  # directions that the search had missed
        close = CONVERGED * state.value
        if result.success and promised - there.value <= close and there.value >= state.value - close:
            return _optimum(bench, program, result, trial, moved, cuts, there.value)
        cuts = np.concatenate([cuts, there.directions[new_directions(bench, cuts, there.directions)]])
        if there.value > state.value:
            state.points, state.hand, state.value = trial, moved, there.value
        else:
            radius *= 0.5
    return None


def _optimum(
    bench: Workbench,
    program: Program,
    result: NlpResult,
    points: FloatArray,
    hand: dict[str, FloatArray],
    cuts: FloatArray,
    value: float,
) -> Optimum:
    """Return the optimum in the user's units: multipliers over the program's scales."""
    scale = bench.scaling.beta
    support = -result.multipliers[program.rows_named("support, direction")][: len(cuts)]
    rows = np.array([row.scale for row in bench.constraint_rows])
    bounds = {}
    for name, block in program.hand_blocks:
        bounds[name] = result.bound_multipliers[block.range] / (scale * block.scale)
    weights = np.maximum(support, 0.0)
    return Optimum(
        points,
        hand,
        value,
        cuts,
        weights / max(float(weights.sum()), 1e-300),
        result.multipliers[program.placement] / (scale * rows),
        bounds,
    )


def _price(bench: Workbench, faces: tuple[str, ...], optimum: Optimum, limit: Limit) -> ShadowPrice | None:
    """Return the price of one limit, by central differences of the rows and ratios it enters."""
    h = 1e-3 * limit.step
    more, less = limit.changed(h), limit.changed(-h)
    rooms = [_room(bench, faces, optimum, problem) for problem in (more, less)]
    if any(len(room) != len(optimum.prices) for room in rooms):
        return None  # rows come or go with the limit: it is at a threshold, where it has no price
    active = np.abs(optimum.prices) > 0.0
    gain = float(np.sum(optimum.prices[active] * (rooms[0] - rooms[1])[active])) / (2.0 * h)
    if limit.touches_contacts:
        ratios = (_ratios(bench, faces, optimum, more) - _ratios(bench, faces, optimum, less)) / (2.0 * h)
        gain += float(optimum.weights @ ratios)
    return ShadowPrice(limit.name, limit.value, limit.step, limit.unit, gain * limit.step)


def _room(bench: Workbench, faces: tuple[str, ...], optimum: Optimum, problem: GraspProblem) -> FloatArray:
    """Return each row's active limit less its value, at the optimum, for a changed problem."""
    normals = bench.inward_normals(faces, optimum.points)
    p, n = ([ca.DM(v) for v in values] for values in (optimum.points, normals))
    variables = {name: ca.DM(v) for name, v in optimum.hand.items()}
    placement = placement_of(problem.hand, p, n, variables, problem.body.size)
    given = given_rows(problem.body, problem.constraints, problem.hand, placement, variables)
    found = collected(given, False)
    values = [float(ca.evalf(ca.SX(row.expression))) for row in found.rows]
    values += [float(c.distance(ca.evalf(ca.SX(c.point)))) for c in found.clearances]
    if len(values) != len(optimum.prices):
        return np.array(values)
    bounds = [row.upper if price > 0.0 else row.lower for row, price in zip(found.named, optimum.prices, strict=True)]
    return np.array([b - v if np.isfinite(b) else -v for b, v in zip(bounds, values, strict=True)])


def _ratios(bench: Workbench, faces: tuple[str, ...], optimum: Optimum, problem: GraspProblem) -> FloatArray:
    normals = bench.inward_normals(faces, optimum.points)
    grasp = Grasp(optimum.points, normals, problem.models, problem.origin)
    return WrenchSet.of(grasp, problem.budget).support(optimum.cuts)[0]


def _joint_prices(bench: Workbench, optimum: Optimum) -> list[ShadowPrice]:
    """Return the prices of a degree (a millimetre) more joint range."""
    hand = bench.problem.hand
    if not isinstance(hand, URDFHand):
        return []
    result = []
    for joint, limits, price in zip(
        hand.robot.free_joints, hand.tree.joint_limits.T, optimum.bounds["joints"], strict=True
    ):
        if price == 0.0:
            continue
        which, value = ("upper", limits[1]) if price > 0.0 else ("lower", limits[0])
        step = np.pi / 180.0 if joint.turns else 1e-3
        unit = "1 degree" if joint.turns else "1 mm"
        sign = 1.0 if price > 0.0 else -1.0
        unit += " of range"
        result.append(ShadowPrice(f"{joint.name}, {which} limit", float(value), sign * step, unit, abs(price) * step))
    return result
