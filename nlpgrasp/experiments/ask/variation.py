"""Variations of a base problem: allowed changes, and the resulting problem."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias, TypedDict

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Fingertips
from nlpgrasp.optimize import SolveOptions
from nlpgrasp.optimize.many.collection import ONE, Keeping
from nlpgrasp.problem.problem import GraspProblem

Changes: TypeAlias = Mapping[str, Any]
"""Fields of a problem by name, and the values that replace them: of any field's type."""

Variation: TypeAlias = Changes | GraspProblem | Callable[[], Changes | GraspProblem]
"""What one variation may be: fields to replace, a whole problem, or a function that returns either."""

PARTS = tuple(f.name for f in fields(GraspProblem))
MORE = ("friction", "fingers", "starts", "options")
ALLOWED = f"fields of a GraspProblem ({', '.join(PARTS)}) or {', '.join(MORE)}"


class CaseData(TypedDict, total=False):
    """JSON data of one variation; ``deferred`` alone if a function creates it."""

    deferred: bool
    problem: Json
    starts: int
    options: Json
    keep: int
    distinct: float


@dataclass(frozen=True)
class Case:
    """One variation: a problem with solve options.

    Parameters
    ----------
    problem : GraspProblem
    starts : int
    options : SolveOptions
        With one worker: an experiment parallelises over solves, not starts.
    keeping : Keeping
    """

    problem: GraspProblem
    starts: int
    options: SolveOptions
    keeping: Keeping = ONE

    def to_dict(self) -> CaseData:
        """Return the data that determine the result, as JSON data."""
        problem = {"name": self.problem.name, "torque_origin": self.problem.origin.tolist(), **self.problem.to_dict()}
        options = {k: v for k, v in self.options.to_dict().items() if k != "workers"}
        data: CaseData = {"problem": problem, "starts": self.starts, "options": options}
        if self.keeping.count == 1:
            return data
        return {**data, "keep": self.keeping.count, "distinct": self.keeping.distinct}


def case_of(where: str, base: Case, variation: Variation) -> Case:
    """Return the case of a variation.

    Parameters
    ----------
    where : str
        Shown in messages, for example ``Experiment.variations['table']``.
    base : Case
    variation : mapping, GraspProblem or callable
        Fields to replace, a whole problem, or a function that returns either.

    Raises
    ------
    InputError
        On unknown fields and invalid values.
    """
    if isinstance(variation, type):
        raise InputError(where, variation, "a mapping, a GraspProblem, or a function that returns one")
    given = variation() if callable(variation) else variation
    if isinstance(given, GraspProblem):
        return replace(base, problem=given)
    if not isinstance(given, Mapping):
        raise InputError(where, given, "a mapping of fields to values, a GraspProblem, or a function returning either")
    check_fields(where, given)
    parts = {name: value for name, value in given.items() if name in PARTS}
    try:
        problem = replace(base.problem, **_with_fingers(base.problem, given, parts))
    except InputError as error:
        raise InputError(f"{where}: {error.field}", error.given, error.allowed) from None
    starts = integer(f"{where}.starts", given.get("starts", base.starts), at_least=1, at_most=10**6)
    return Case(problem, starts, _options(where, base.options, given.get("options")), base.keeping)


def settled_changes(changes: Changes) -> Changes:
    """Return changes that can be read repeatedly: constraints from a generator as a tuple."""
    given = changes.get("constraints")
    return {**changes, "constraints": tuple(given)} if isinstance(given, Iterator) else changes


def check_fields(where: str, changes: Changes) -> None:
    """Refuse names that are not fields of a problem."""
    unknown = [name for name in changes if name not in (*PARTS, *MORE)]
    if unknown:
        raise InputError(f"{where}.{unknown[0]}", "a field that does not exist", ALLOWED)


def _with_fingers(base: GraspProblem, given: Changes, parts: Changes) -> Changes:
    """Return the parts with number of fingers and friction applied to contacts and hand."""
    if "fingers" not in given and "friction" not in given:
        return parts
    if "contacts" in parts:
        raise InputError("contacts", "contacts together with fingers or friction", "one or the other")
    models = base.models
    if "fingers" in given:
        count = integer("fingers", given["fingers"], at_least=1)
        if any(m != models[0] for m in models):
            raise InputError("fingers", count, "a base problem whose contacts are all alike, or contacts")
        models = models[:1] * count
        hand = parts.get("hand", base.hand)
        if isinstance(hand, Fingertips) and "hand" not in parts:
            parts = {**parts, "hand": replace(hand, count=count)}
    if "friction" in given:
        friction = number("friction", given["friction"], above=0.0)
        models = tuple(_with_friction(m, friction) for m in models)
    return {**parts, "contacts": models}


def _with_friction(model: ContactModel, friction: float) -> ContactModel:
    if "friction" not in {field.name for field in fields(model)}:
        raise InputError("friction", f"a base problem with a {type(model).__name__}", "contacts with friction")
    return model.with_coefficients(friction=friction)


def _options(where: str, base: SolveOptions, given: object) -> SolveOptions:
    """Return the options of a variation: all of them, or the named ones replaced."""
    if given is None:
        return base
    if isinstance(given, SolveOptions):
        return replace(given, workers=1)
    names = set(base.to_dict()) - {"workers"}
    if not isinstance(given, Mapping) or not set(given) <= names:
        raise InputError(f"{where}.options", given, "an ng.SolveOptions, or a mapping of some of its fields")
    return replace(base, **given)
