"""Shadow prices: what a little more of each limit would buy in mu.

At a local optimum with multipliers lambda of the rows ``g <= limit`` of the program that maximises beta, the
optimum moves with a parameter t by ``sum lambda d(limit - g) / dt`` (the envelope theorem). Rows of containment
count by the support ratio's own derivative: ``sum a_j d(phi_j / phi_A) / dt`` with weights a_j of sum one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import URDFHand
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import collected, given_rows, placement_of
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solve.after.edge_price import edge_price
from nlpgrasp.solve.after.limits import Limit, limits_of
from nlpgrasp.solve.ascent.ascend import Model, Round, Rules, ascend
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.ascent.steps.linear import LinearModel
from nlpgrasp.solve.ascent.steps.nonlinear import NonlinearModel
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.programs import SLOTS
from nlpgrasp.solve.workbench.workbench import Workbench

POLISHING = Rules(rounds=25, radius=0.05, last_radius=0.0, worse=0.5, refused=0.3, allowed=1e-4, looks_back=True)
LINEAR = replace(POLISHING, rounds=30, radius=0.02, last_radius=1e-4, most_radius=0.05, good=1.6, poor=0.5)
ROUNDS_WITH_FORCES = 6
CONVERGED = 3e-5  # relative: the model promises no more than this over what is there
NOTHING = 1e-4  # relative gains below this are none
FAR = 0.25  # relative: an optimum whose value is further from the grasp's mu is another grasp's


@dataclass(frozen=True)
class Optimum:
    """A converged solve of the exchange's program.

    Parameters
    ----------
    placed : Placed
    value : float
        The least support ratio.
    cuts, weights : (m, d) and (m,) arrays
        Directions with ``phi_A = 1`` and their weights, which add up to one.
    prices : (rows,) array
        ``d mu / d limit`` of the rows of constraints and hand, in the rows' own units.
    bounds : dict
        ``d mu / d bound`` of the hand's variables by name: positive where the upper bound binds, negative the lower.
    """

    placed: Placed
    value: float
    cuts: FloatArray
    weights: FloatArray
    prices: FloatArray
    bounds: dict[str, FloatArray]


def shadow_prices(bench: Workbench, best: StartGrasp, stop: Stop) -> tuple[ShadowPrice, ...]:
    """Return the prices of all limits of constraints, hand and contacts, the dearest first.

    None where the last solves do not converge, for a grasp that was cut short or that differs too much on its mesh from
    the optimum on the smooth surface near it, and under a hand's torque limits, whose derivatives the program does
    not hold.
    """
    if bench.problem.budget.follows_hand:
        return ()
    optimum = polish(bench, [best.ascended, bench.snapped(best.found.placed)], stop, best.record.mu.lower)
    if optimum is None:
        return ()
    found = [price_of(bench, optimum, limit) for limit in limits_of(bench.problem)]
    found.append(edge_price(bench, optimum.placed, lambda placed: _lagrangian(bench, optimum, placed)))
    prices = [price for price in found if price is not None] + _joint_prices(bench, optimum)
    prices = [p for p in prices if abs(p.gain) > NOTHING * optimum.value]
    return tuple(sorted(prices, key=lambda p: -abs(p.gain)))


def polish(bench: Workbench, begins: Sequence[Placed], stop: Stop, known: float) -> Optimum | None:
    """Return a local optimum near a grasp with its multipliers, or None where the exchange does not settle at one.

    A few quadratic programs mostly settle, a tenth of a second from where the exchange ended. IPOPT is asked where they
    do not, but of a hand with a pose and of a mesh, for which it takes seconds, and where the program has forces of its
    own.

    Parameters
    ----------
    bench : Workbench
    begins : sequence of Placed
        Where its exchange ended, and the grasp: fingers that went over a mesh since then may be off the smooth
        surface's constraints, and far from its optimum.
    stop : Stop
    known : float
        The grasp's mu.
    """
    for begin in begins if bench.exchange.linearises else ():
        found = settled_at(bench, begin, LinearModel(bench), LINEAR, stop)
        if found is not None and abs(found.value - known) <= FAR * known:
            return found
    slow = isinstance(bench.problem.body, Mesh) or not bench.follows_contacts
    if bench.exchange.linearises and (slow or not bench.exchange.closed):
        return None
    rules = POLISHING if bench.exchange.slots == SLOTS else replace(POLISHING, rounds=ROUNDS_WITH_FORCES)
    found = settled_at(bench, begins[-1], NonlinearModel(bench), rules, stop)
    return found if found is not None and abs(found.value - known) <= FAR * known else None


def settled_at(bench: Workbench, placed: Placed, model: Model, rules: Rules, stop: Stop) -> Optimum | None:
    """Return the optimum where an ascent with a model settles, None where it does not."""
    rng = np.random.default_rng(0)
    found = weakest_at(bench, placed, rng)
    state = AscentState(placed, found.value, found.directions)
    if state.value <= 0.0:
        return None
    for turn in ascend(bench, state, model, rules, rng, stop):
        if _settled(turn):
            return _optimum(bench, turn)
        if state.value <= 0.0:
            break
    return None


def _settled(turn: Round) -> bool:
    """Return whether the model, the trial and where it began agree."""
    step, there, close = turn.step, turn.trial.value, CONVERGED * turn.before
    promised = turn.before + step.promised
    return step.solved and promised - there <= close and there >= turn.before - close


def _optimum(bench: Workbench, turn: Round) -> Optimum:
    """Return the optimum in the user's units: multipliers over the program's scales."""
    program, step, scale = bench.exchange.compiled.program, turn.step, bench.scaling.beta
    rows = np.array([row.scale for row in bench.rows.named])
    bounds = {}
    for name, block in program.hand_blocks:
        bounds[name] = step.bound_multipliers[block.range] / (scale * block.scale)
    weights = np.maximum(step.support, 0.0)
    return Optimum(
        step.placed,
        turn.trial.value,
        turn.cuts,
        weights / max(float(weights.sum()), 1e-300),
        step.multipliers / (scale * rows),
        bounds,
    )


def price_of(bench: Workbench, optimum: Optimum, limit: Limit) -> ShadowPrice | None:
    """Return the price of one limit, by central differences of the rows and ratios it enters."""
    h = 1e-3 * limit.step
    more, less = limit.changed(h), limit.changed(-h)
    gain, own = 0.0, bench.problem
    if more.hand is not own.hand or more.constraints != own.constraints:
        rooms = [_room(bench, optimum, problem) for problem in (more, less)]
        if any(len(room) != len(optimum.prices) for room in rooms):
            return None  # rows come or go with the limit: it is at a threshold, where it has no price
        active = np.abs(optimum.prices) > 0.0
        gain = float(np.sum(optimum.prices[active] * (rooms[0] - rooms[1])[active])) / (2.0 * h)
    if limit.touches_contacts:
        ratios = (_ratios(bench, optimum, more) - _ratios(bench, optimum, less)) / (2.0 * h)
        gain += float(optimum.weights @ ratios)
    return ShadowPrice(limit.name, limit.value, limit.step, limit.unit, gain * limit.step)


def _lagrangian(bench: Workbench, optimum: Optimum, placed: Placed) -> float:
    """Return the weighted ratios of another placement and what the room that its rows leave is worth."""
    there = replace(optimum, placed=placed)
    room, active = _room(bench, there, bench.problem), np.abs(optimum.prices) > 0.0
    ratios = _ratios(bench, there, bench.problem)
    return float(optimum.weights @ ratios + np.sum((optimum.prices * room)[active]))


def _room(bench: Workbench, optimum: Optimum, problem: GraspProblem) -> FloatArray:
    """Return each row's active limit less its value, at the optimum, for a changed problem."""
    normals = bench.inward_normals(optimum.placed)
    p, n = ([ca.DM(v) for v in values] for values in (optimum.placed.points, normals))
    variables = {name: ca.DM(v) for name, v in optimum.placed.hand.items()}
    placement = placement_of(problem.hand, p, n, variables, problem.body.size)
    given = given_rows(problem.body, problem.constraints, problem.hand, placement, variables)
    found = collected(given, False)
    values = [float(ca.evalf(ca.SX(row.expression))) for row in found.rows]
    values += [float(c.distance(ca.evalf(ca.SX(c.point)))) for c in found.clearances]
    if len(values) != len(optimum.prices):
        return np.array(values)
    bounds = [row.upper if price > 0.0 else row.lower for row, price in zip(found.named, optimum.prices, strict=True)]
    return np.array([b - v if np.isfinite(b) else -v for b, v in zip(bounds, values, strict=True)])


def _ratios(bench: Workbench, optimum: Optimum, problem: GraspProblem) -> FloatArray:
    normals = bench.inward_normals(optimum.placed)
    grasp = Grasp(optimum.placed.points, normals, problem.models, problem.origin)
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
