"""Adjustable limits of a problem: of its constraints, hand and contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Generic, TypeVar

import numpy as np

from nlpgrasp.common.frozen import unchecked
from nlpgrasp.constraints import BoxRegion, Constraint, HalfSpace, PlacementConstraint
from nlpgrasp.hands import Hand, URDFHand
from nlpgrasp.problem.problem import GraspProblem

MILLIMETRE, DEGREE, TENTH = (1e-3, "1 mm"), (np.pi / 180.0, "1 degree"), (0.1, "0.1")
STEPS = {"angle": DEGREE, "tilt": DEGREE, "friction": TENTH}
Item = TypeVar("Item")
NO_LIMITS = ("count", "tolerance", "palm", "length")


@dataclass(frozen=True)
class Number(Generic[Item]):
    """Adjustable number of a constraint or a hand.

    Parameters
    ----------
    name : str
    value : float
        SI units.
    changed : callable
        ``changed(h)`` is the constraint or hand with the number larger by h.
    step : (float, str)
        What its price is for, SI units and in words.
    """

    name: str
    value: float
    changed: Callable[[float], Item]
    step: tuple[float, str] = MILLIMETRE


@dataclass(frozen=True)
class Limit:
    """Adjustable number of a problem, with its unit and step.

    Parameters
    ----------
    name : str
    value : float
        SI units.
    step : float
        What its price is for, SI units.
    unit : str
        The step in words.
    changed : callable
        ``changed(h)`` is the problem with the number larger by h.
    touches_contacts : bool
        Whether the grasp's own wrenches change with it.
    """

    name: str
    value: float
    step: float
    unit: str
    changed: Callable[[float], GraspProblem]
    touches_contacts: bool = False


def limits_of(problem: GraspProblem) -> list[Limit]:
    """Return all limits of constraints, hand and contacts."""
    result: list[Limit] = []
    for i, constraint in enumerate(problem.constraints):
        for number in _constraint_numbers(constraint):
            changed = _constraint_change(problem, i, number.changed)
            result.append(Limit(number.name, number.value, *number.step, changed))
    if problem.hand is not None:
        for of_hand in _hand_numbers(problem.hand):
            changed = _hand_change(problem, of_hand.changed)
            result.append(Limit(of_hand.name, of_hand.value, *of_hand.step, changed))
    return result + _contact_limits(problem)


def _constraint_change(
    problem: GraspProblem, i: int, new: Callable[[float], PlacementConstraint]
) -> Callable[[float], GraspProblem]:
    def changed(h: float) -> GraspProblem:
        constraints = list(problem.constraints)
        constraints[i] = new(h)
        return problem.unchecked(constraints=tuple(constraints))

    return changed


def _hand_change(problem: GraspProblem, new: Callable[[float], Hand]) -> Callable[[float], GraspProblem]:
    return lambda h: problem.unchecked(hand=new(h))


def _constraint_numbers(item: PlacementConstraint) -> list[Number[PlacementConstraint]]:
    """Return name, value and a setter for each number of a constraint."""
    if not isinstance(item, Constraint):
        return _field_numbers(item)
    pairs = [(name, np.asarray(getattr(item, name), dtype=float)) for name in ("lower", "upper")]
    return [
        Number(f"Constraint {item.name!r}.{name}", value, _field_change(item, name, value), _hundredth(value))
        for name, value in ((name, float(value)) for name, value in pairs if value.size == 1)
        if np.isfinite(value)
    ]


def _hundredth(value: float) -> tuple[float, str]:
    """Return the step of a number in user-defined units: a hundredth of it."""
    step = 0.01 * max(abs(value), 1e-3)
    return step, f"{step:g}"


def _hand_numbers(hand: Hand) -> list[Number[Hand]]:
    """Return name, value and a setter for each number of a hand."""
    if isinstance(hand, URDFHand):
        return [Number("URDFHand.clearance", hand.clearance, lambda h: hand.with_clearance(hand.clearance + h))]
    return _field_numbers(hand)


def _field_numbers(item: Item) -> list[Number[Item]]:
    """Return the numbers among a dataclass's fields, and in the regions and ranges it holds."""
    if not is_dataclass(item):
        return []
    label = type(item).__name__
    result: list[Number[Item]] = []
    for field in fields(item):
        value, name = getattr(item, field.name), f"{label}.{field.name}"
        if field.name in NO_LIMITS or isinstance(value, bool | str):
            continue
        if isinstance(value, float):
            step = STEPS.get(field.name, MILLIMETRE)
            result.append(Number(name, value, _field_change(item, field.name, value), step))
        elif isinstance(value, HalfSpace):
            change = _part_change(item, field.name, value, "offset", None)
            result.append(Number(f"{name}.offset", float(value.offset), change))
        elif isinstance(value, BoxRegion):
            for side in ("lower", "upper"):
                for axis, number in enumerate(np.asarray(getattr(value, side), dtype=float)):
                    change = _part_change(item, field.name, value, side, axis)
                    result.append(Number(f"{name}.{side}[{axis}]", float(number), change))
        elif field.name == "spread" and isinstance(value, tuple):
            for place, which in enumerate(("least", "greatest")):
                if np.isfinite(value[place]) and value[place] > 0.0:
                    change = _entry_change(item, field.name, value, place)
                    result.append(Number(f"{name} ({which})", float(value[place]), change))
    return result


def _field_change(item: Item, name: str, value: float) -> Callable[[float], Item]:
    return lambda h: unchecked(item, **{name: value + h})


def _entry_change(item: Item, name: str, values: tuple[float, ...], place: int) -> Callable[[float], Item]:
    return lambda h: unchecked(item, **{name: tuple(v + h * (i == place) for i, v in enumerate(values))})


def _part_change(
    item: Item, name: str, region: HalfSpace | BoxRegion, side: str, axis: int | None
) -> Callable[[float], Item]:
    """Return a setter for a number of a region that a constraint holds."""

    def changed(h: float) -> Item:
        value = np.array(getattr(region, side), dtype=float)
        if axis is None:
            return unchecked(item, **{name: unchecked(region, **{side: float(value + h)})})
        value[axis] += h
        return unchecked(item, **{name: unchecked(region, **{side: tuple(value.tolist())})})

    return changed


def _contact_limits(problem: GraspProblem) -> list[Limit]:
    """Return friction and torsional friction, of all contacts together where they are alike."""
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
                    unchecked(m, **{name: value + h}) if i in members else m for i, m in enumerate(problem.models)
                ]
                return problem.unchecked(contacts=tuple(models))

            result.append(Limit(f"{name} of {label}", value, step, unit, changed, touches_contacts=True))
    return result
