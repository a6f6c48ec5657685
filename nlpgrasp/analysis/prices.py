"""Shadow prices: sensitivity of mu to the limits of constraints, hand and contacts.

At a local optimum with multipliers lambda of the rows ``g <= limit`` of the program that maximises beta, the
optimum moves with a parameter t by ``sum lambda d(limit - g) / dt`` (the envelope theorem). Rows of containment
count by the support ratio's own derivative: ``sum a_j d(phi_j / phi_A) / dt`` with weights a_j of sum one.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from nlpgrasp.analysis.edge_price import edge_price
from nlpgrasp.analysis.limits import Limit, limits_of
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.ascent.local_optimum import LocalOptimum, local_optimum
from nlpgrasp.optimize.start.result import StartGrasp
from nlpgrasp.optimize.surface.triangles import on_triangles
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import collected, given_rows, placement_of
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solution.prices import ShadowPrice

NOTHING = 1e-4  # smaller relative gains count as zero
FAR = 0.02  # relative: an optimum whose value differs more from the grasp's mu belongs to another grasp


def shadow_prices(bench: Workbench, best: StartGrasp, stop: Stop) -> tuple[ShadowPrice, ...]:
    """Return the shadow prices of all limits of constraints, hand and contacts, the largest first.

    None for an answer that is not at a local optimum: without multipliers limits have no prices. An answer that is, but
    was read from a file, is solved once more from where it is.
    """
    optimum = best.optimum
    if optimum is None and best.kkt is None:
        optimum = local_optimum(*on_triangles(bench, best.found.placed), stop)
    known = best.record.mu.upper
    if optimum is None or not optimum.kkt.is_small or abs(optimum.value - known) > FAR * known:
        return ()
    own = on_triangles(bench, optimum.placed)[0]
    found = [price_of(own, optimum, limit) for limit in limits_of(own.problem)]
    found.append(edge_price(own, optimum.placed, lambda placed: _lagrangian(own, optimum, placed)))
    prices = [price for price in found if price is not None] + _joint_prices(bench, optimum)
    prices = [p for p in prices if abs(p.gain) > NOTHING * optimum.value]
    return tuple(sorted(prices, key=lambda p: -abs(p.gain)))


def price_of(bench: Workbench, optimum: LocalOptimum, limit: Limit) -> ShadowPrice | None:
    """Return the shadow price of one limit, by central differences of the constraints and ratios it enters."""
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


def _lagrangian(bench: Workbench, optimum: LocalOptimum, placed: Placed) -> float:
    """Return the Lagrangian of another placement: weighted ratios and priced constraint slack."""
    there = replace(optimum, placed=placed)
    room, active = _room(bench, there, bench.problem), np.abs(optimum.prices) > 0.0
    ratios = _ratios(bench, there, bench.problem)
    return float(optimum.weights @ ratios + np.sum((optimum.prices * room)[active]))


def _room(bench: Workbench, optimum: LocalOptimum, problem: GraspProblem) -> FloatArray:
    """Return each constraint's slack to its active limit, at the optimum, for a changed problem."""
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


def _ratios(bench: Workbench, optimum: LocalOptimum, problem: GraspProblem) -> FloatArray:
    normals = bench.inward_normals(optimum.placed)
    grasp = Grasp(optimum.placed.points, normals, problem.models, problem.origin)
    return WrenchSet.of(grasp, problem.budget).support(optimum.cuts)[0]


def _joint_prices(bench: Workbench, optimum: LocalOptimum) -> list[ShadowPrice]:
    """Return the shadow prices of joint limits, per degree or millimetre of range."""
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
