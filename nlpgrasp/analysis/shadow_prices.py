"""Shadow prices: change of mu per change of a limit of constraints, hand or contacts.

At a local optimum with multipliers lambda of the constraints ``g <= limit`` of the program that maximises beta, the
optimum moves with a parameter t by ``sum lambda d(limit - g) / dt`` (the envelope theorem). Constraints of
containment count by the support ratio's own derivative: ``sum a_j d(phi_j / phi_A) / dt`` with weights a_j of sum one.

The derivatives are central differences. A price is stated for a limit's usual step, such as 1 mm, 1 degree or 0.1 of
friction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Generic, TypeVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies.mesh.facets import Facets
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray, replace_unchecked
from nlpgrasp.constraints import BoxRegion, Constraint, HalfSpace, PlacementConstraint
from nlpgrasp.hands import Hand, URDFHand
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.kkt_point import LocalOptimum, find_local_optimum
from nlpgrasp.optimize.link_rows import LinkRows
from nlpgrasp.optimize.projection import fix_to_triangles
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.problem.candidate_constraints import collect_constraints, symbolic_candidate, symbolic_constraints
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.analysis_records import ShadowPrice

EDGE_STEP = 1e-3  # metres: step of the edge margin
EDGE_TOLERANCE = 1e-4  # over the body's size: a contact this near to the edge margin is at it
STEP = 1e-5  # over the body's size: step of central differences in contact positions
MILLIMETRE, DEGREE, TENTH = (1e-3, "1 mm"), (np.pi / 180.0, "1 degree"), (0.1, "0.1")  # steps: SI units and text
STEPS = {"angle": DEGREE, "tilt": DEGREE, "friction": TENTH}  # by the name of a field; a millimetre for the others
NO_LIMITS = ("count", "tolerance", "palm", "length")  # fields that are numbers, but no limits
LEAST_GAIN = 1e-4  # smaller relative gains count as zero
VALUE_TOLERANCE = 0.02  # relative: an optimum whose value differs more from the grasp's mu belongs to another grasp
Item = TypeVar("Item")


def shadow_prices(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> tuple[ShadowPrice, ...]:
    """Return the shadow prices of all limits of constraints, hand and contacts, largest first.

    Empty for an answer that is not at a local optimum: without multipliers limits have no prices. An answer read from a
    file is solved once more from its grasp.
    """
    optimum = best.optimum
    if optimum is None and best.kkt is None:
        on_faces, candidate = fix_to_triangles(compiled, best.on_body.candidate)
        rows = compiled.link_rows_near(candidate)
        on_faces = on_faces if rows is None else on_faces.with_link_rows(rows)
        optimum = find_local_optimum(on_faces, candidate, deadline)
    mu_upper = best.record.mu.upper
    if optimum is None or not optimum.kkt.is_small or abs(optimum.value - mu_upper) > VALUE_TOLERANCE * mu_upper:
        return ()
    fixed = fix_to_triangles(compiled, optimum.candidate)[0]
    results = [shadow_price(fixed, optimum, limit) for limit in limits_of(fixed.problem)]
    results.append(edge_price(fixed, optimum.candidate, lambda candidate: _lagrangian(fixed, optimum, candidate)))
    prices = [price for price in results if price is not None] + _joint_prices(compiled, optimum)
    prices = [p for p in prices if abs(p.gain) > LEAST_GAIN * optimum.value]
    return tuple(sorted(prices, key=lambda p: -abs(p.gain)))


def shadow_price(compiled: CompiledProblem, optimum: LocalOptimum, limit: Limit) -> ShadowPrice | None:
    """Return the shadow price of one limit, by central differences."""
    h = 1e-3 * limit.step
    increased, decreased = limit.increased(h), limit.increased(-h)
    gain, problem = 0.0, compiled.problem
    if increased.hand is not problem.hand or increased.constraints != problem.constraints:
        slacks = [_constraint_slack(compiled, optimum, changed) for changed in (increased, decreased)]
        if any(len(slack) != len(optimum.prices) for slack in slacks):
            return None  # constraints come or go with the limit: it is at a threshold, where it has no price
        active = np.abs(optimum.prices) > 0.0
        gain = float(np.sum(optimum.prices[active] * (slacks[0] - slacks[1])[active])) / (2.0 * h)
        if optimum.link_rows is not None and np.any(optimum.link_prices):
            links = [_link_clearances(optimum.link_rows, optimum, changed) for changed in (increased, decreased)]
            gain += float(optimum.link_prices[: len(links[0])] @ (links[1] - links[0])) / (2.0 * h)
    if limit.touches_contacts:
        ratios = (_support_ratios(compiled, optimum, increased) - _support_ratios(compiled, optimum, decreased)) / (
            2.0 * h
        )
        gain += float(optimum.weights @ ratios)
    return ShadowPrice(limit.name, limit.value, limit.step, limit.unit, gain * limit.step)


def edge_price(
    compiled: CompiledProblem, candidate: GraspCandidate, lagrangian: Callable[[GraspCandidate], float]
) -> ShadowPrice | None:
    """Return the shadow price of the margin from sharp edges; None unless some contact is at the margin.

    It is the change of mu per millimetre. A margin larger by h moves each contact that stands at it away from its edges
    by h. By the envelope theorem mu changes as the Lagrangian does with the contacts so moved, everything else left as
    it is.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
        A local optimum.
    lagrangian : callable
        The Lagrangian at another placement: weighted ratios and priced constraints.
    """
    problem = compiled.problem
    if problem.margin == 0.0 or isinstance(problem.body, Facets):
        return None
    contacts = zip(candidate.faces, candidate.points, strict=True)
    directions = np.array([_step_off_edges(compiled, face, point) for face, point in contacts])
    if not np.any(directions):
        return None
    h = STEP * problem.body.size
    more, less = (
        lagrangian(compiled.projected_onto_faces(replace(candidate, points=candidate.points + s * h * directions)))
        for s in (1.0, -1.0)
    )
    return ShadowPrice("GraspProblem.edge_margin", problem.margin, EDGE_STEP, "1 mm", (more - less) / (2.0 * h) * 1e-3)


@dataclass(frozen=True)
class Limit:
    """A limit of a problem that can be changed, with its unit and step.

    Parameters
    ----------
    name : str
    value : float
        SI units.
    step : float
        Step of its price, SI units.
    unit : str
        The step as text.
    increased : callable
        ``increased(h)`` is the problem with the number larger by h.
    touches_contacts : bool
        Whether the grasp's own wrenches change with it.
    """

    name: str
    value: float
    step: float
    unit: str
    increased: Callable[[float], GraspProblem]
    touches_contacts: bool = False


def limits_of(problem: GraspProblem) -> list[Limit]:
    """Return all limits of constraints, hand and contacts."""
    result: list[Limit] = []
    for i, constraint in enumerate(problem.constraints):
        for parameter in _constraint_parameters(constraint):
            changed = _constraint_change(problem, i, parameter.increased)
            result.append(Limit(parameter.name, parameter.value, *parameter.step, changed))
    if problem.hand is not None:
        for parameter_of_hand in _hand_parameters(problem.hand):
            changed = _hand_change(problem, parameter_of_hand.increased)
            result.append(Limit(parameter_of_hand.name, parameter_of_hand.value, *parameter_of_hand.step, changed))
    return result + _contact_limits(problem)


def _lagrangian(compiled: CompiledProblem, optimum: LocalOptimum, candidate: GraspCandidate) -> float:
    """Return the Lagrangian at a candidate, with the multipliers of a local optimum.

    It is the sum of weighted support ratios and of the priced slacks of active constraints, for ``edge_price``.
    """
    moved = replace(optimum, candidate=candidate)
    slack, active = _constraint_slack(compiled, moved, compiled.problem), np.abs(optimum.prices) > 0.0
    ratios = _support_ratios(compiled, moved, compiled.problem)
    return float(optimum.weights @ ratios + np.sum((optimum.prices * slack)[active]))


def _constraint_slack(compiled: CompiledProblem, optimum: LocalOptimum, problem: GraspProblem) -> FloatArray:
    """Return the slack of each constraint to its active limit, for a changed problem at the optimum."""
    normals = compiled.inward_normals(optimum.candidate)
    p, n = ([ca.DM(v) for v in values] for values in (optimum.candidate.points, normals))
    variables = {name: ca.DM(v) for name, v in optimum.candidate.hand.items()}
    symbols = symbolic_candidate(problem.hand, p, n, variables, problem.body.size)
    symbolic = symbolic_constraints(problem.body, problem.constraints, problem.hand, symbols, variables)
    constraints = collect_constraints(symbolic, False)
    values = [float(ca.evalf(ca.SX(constraint.expression))) for constraint in constraints.rows]
    values += [float(c.distance(ca.evalf(ca.SX(c.point)))) for c in constraints.clearances]
    if len(values) != len(optimum.prices):
        return np.array(values)
    bounds = [
        constraint.upper if price > 0.0 else constraint.lower
        for constraint, price in zip(constraints.named, optimum.prices, strict=True)
    ]
    return np.array([b - v if np.isfinite(b) else -v for b, v in zip(bounds, values, strict=True)])


def _link_clearances(rows: LinkRows, optimum: LocalOptimum, problem: GraspProblem) -> FloatArray:
    """Return the clearances of links that the program held, metres, for a changed problem at the optimum."""
    values, hand = optimum.candidate.hand, problem.hand
    if not isinstance(hand, URDFHand):
        return np.zeros(0)
    changed = replace(rows, clearance=HandClearance(problem, hand, rows.clearance.parts))
    return np.asarray(changed.rows(values)[0][rows.held(rows.rows(values)[0])])


def _support_ratios(compiled: CompiledProblem, optimum: LocalOptimum, problem: GraspProblem) -> FloatArray:
    """Return the supports (m,) of a changed problem's wrench set along the optimum's cut directions.

    They are support ratios, as ``phi_A = 1`` along each.
    """
    normals = compiled.inward_normals(optimum.candidate)
    grasp = Grasp(optimum.candidate.points, normals, problem.models, problem.origin)
    return WrenchSet.of(grasp, problem.budget).support(optimum.cuts)[0]


def _joint_prices(compiled: CompiledProblem, optimum: LocalOptimum) -> list[ShadowPrice]:
    """Return the shadow prices of joint limits, per degree or millimetre of range."""
    hand = compiled.problem.hand
    if not isinstance(hand, URDFHand):
        return []
    result = []
    for joint, limits, price in zip(
        hand.robot.free_joints, hand.tree.joint_limits.T, optimum.bounds["joints"], strict=True
    ):
        if price == 0.0:
            continue
        side, value = ("upper", limits[1]) if price > 0.0 else ("lower", limits[0])
        step = np.pi / 180.0 if joint.is_revolute else 1e-3
        unit = "1 degree" if joint.is_revolute else "1 mm"
        sign = 1.0 if price > 0.0 else -1.0
        unit += " of range"
        result.append(ShadowPrice(f"{joint.name}, {side} limit", float(value), sign * step, unit, abs(price) * step))
    return result


def _step_off_edges(compiled: CompiledProblem, face: str, point: FloatArray) -> FloatArray:
    """Return the shortest displacement (space,) whose linearised distance from each active edge grows by a metre.

    It is linearised. An edge is active if the contact is at its margin; without such edges the displacement is zero.
    """
    body, h = compiled.problem.body, STEP * compiled.problem.body.size
    surface = body.surface_function(face, compiled.problem.margin)

    def limits(p: FloatArray) -> FloatArray:
        return np.asarray(surface(p)[3].full()).ravel()

    active = np.flatnonzero(limits(point) >= -EDGE_TOLERANCE * body.size)
    if not active.size:
        return np.zeros(len(point))
    slopes = np.stack([(limits(point + h * e) - limits(point - h * e))[active] for e in np.eye(len(point))], axis=1)
    return np.asarray(-np.linalg.pinv(slopes / (2.0 * h)) @ np.ones(len(active)))


@dataclass(frozen=True)
class Parameter(Generic[Item]):
    """Numeric parameter of a constraint or a hand, with the function that changes it.

    Parameters
    ----------
    name : str
    value : float
        SI units.
    increased : callable
        ``increased(h)`` is the constraint or hand with the number larger by h.
    step : (float, str)
        Step of its price: in SI units, and as text.
    """

    name: str
    value: float
    increased: Callable[[float], Item]
    step: tuple[float, str] = MILLIMETRE


def _constraint_parameters(item: PlacementConstraint) -> list[Parameter[PlacementConstraint]]:
    """Return the numeric parameters of a constraint."""
    if not isinstance(item, Constraint):
        return _field_parameters(item)
    pairs = [(name, np.asarray(getattr(item, name), dtype=float)) for name in ("lower", "upper")]
    return [
        Parameter(f"Constraint {item.name!r}.{name}", value, _field_change(item, name, value), _hundredth(value))
        for name, value in ((name, float(value)) for name, value in pairs if value.size == 1)
        if np.isfinite(value)
    ]


def _hand_parameters(hand: Hand) -> list[Parameter[Hand]]:
    """Return the numeric parameters of a hand."""
    if isinstance(hand, URDFHand):
        return [Parameter("URDFHand.clearance", hand.clearance, lambda h: hand.with_clearance(hand.clearance + h))]
    return _field_parameters(hand)


def _contact_limits(problem: GraspProblem) -> list[Limit]:
    """Return the friction coefficients of the contacts as limits, one for contacts with equal coefficients."""
    result = []
    for name, (step, unit) in (("friction", TENTH), ("torsional_friction", MILLIMETRE)):
        groups: dict[float, list[int]] = {}
        for i, model in enumerate(problem.models):
            if name in model.coefficients:
                groups.setdefault(model.coefficients[name], []).append(i)
        for value, members in groups.items():
            label = (
                "all contacts" if len(members) == len(problem.models) else f"contacts {', '.join(map(str, members))}"
            )

            def changed(h: float, name: str = name, value: float = value, members: list[int] = members) -> GraspProblem:
                models = [
                    replace_unchecked(m, **{name: value + h}) if i in members else m
                    for i, m in enumerate(problem.models)
                ]
                return problem.unchecked(contacts=tuple(models))

            result.append(Limit(f"{name} of {label}", value, step, unit, changed, touches_contacts=True))
    return result


def _field_parameters(item: Item) -> list[Parameter[Item]]:
    """Return the numeric parameters of a dataclass, including those of its regions and ranges."""
    if not is_dataclass(item):
        return []
    class_name = type(item).__name__
    result: list[Parameter[Item]] = []
    for field in fields(item):
        value, name = getattr(item, field.name), f"{class_name}.{field.name}"
        if field.name in NO_LIMITS or isinstance(value, bool | str):
            continue
        if isinstance(value, float):
            step = STEPS.get(field.name, MILLIMETRE)
            result.append(Parameter(name, value, _field_change(item, field.name, value), step))
        elif isinstance(value, HalfSpace):
            change = _region_change(item, field.name, value, "offset", None)
            result.append(Parameter(f"{name}.offset", float(value.offset), change))
        elif isinstance(value, BoxRegion):
            for side in ("lower", "upper"):
                for axis, coordinate in enumerate(np.asarray(getattr(value, side), dtype=float)):
                    change = _region_change(item, field.name, value, side, axis)
                    result.append(Parameter(f"{name}.{side}[{axis}]", float(coordinate), change))
        elif field.name == "spread" and isinstance(value, tuple):
            for index, label in enumerate(("least", "greatest")):
                if np.isfinite(value[index]) and value[index] > 0.0:
                    change = _entry_change(item, field.name, value, index)
                    result.append(Parameter(f"{name} ({label})", float(value[index]), change))
    return result


def _hundredth(value: float) -> tuple[float, str]:
    """Return a hundredth of a parameter's value, as the step of its shadow price.

    The step is in SI units and as text. Values below 1e-3 count as 1e-3.
    """
    step = 0.01 * max(abs(value), 1e-3)
    return step, f"{step:g}"


def _constraint_change(
    problem: GraspProblem, i: int, change: Callable[[float], PlacementConstraint]
) -> Callable[[float], GraspProblem]:
    """Return the function from an increment of a constraint's parameter to the changed problem."""

    def changed(h: float) -> GraspProblem:
        constraints = list(problem.constraints)
        constraints[i] = change(h)
        return problem.unchecked(constraints=tuple(constraints))

    return changed


def _hand_change(problem: GraspProblem, change: Callable[[float], Hand]) -> Callable[[float], GraspProblem]:
    """Return the function from an increment of a hand's parameter to the changed problem."""
    return lambda h: problem.unchecked(hand=change(h))


def _field_change(item: Item, name: str, value: float) -> Callable[[float], Item]:
    """Return the function from an increment of a field to the changed item."""
    return lambda h: replace_unchecked(item, **{name: value + h})


def _entry_change(item: Item, name: str, values: tuple[float, ...], index: int) -> Callable[[float], Item]:
    """Return the function from an increment of one entry of a tuple to the changed item."""
    return lambda h: replace_unchecked(item, **{name: tuple(v + h * (i == index) for i, v in enumerate(values))})


def _region_change(
    item: Item, name: str, region: HalfSpace | BoxRegion, side: str, axis: int | None
) -> Callable[[float], Item]:
    """Return the function from an increment of a region's parameter to the changed item."""

    def changed(h: float) -> Item:
        value = np.array(getattr(region, side), dtype=float)
        if axis is None:
            return replace_unchecked(item, **{name: replace_unchecked(region, **{side: float(value + h)})})
        value[axis] += h
        return replace_unchecked(item, **{name: replace_unchecked(region, **{side: tuple(value.tolist())})})

    return changed
