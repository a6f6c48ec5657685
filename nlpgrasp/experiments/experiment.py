"""Plan of an experiment: a base problem with variations and seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from typing import Any, TypeAlias, TypedDict, cast

from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Fingertips
from nlpgrasp.optimize import SolveOptions
from nlpgrasp.optimize.distinct_grasps import ONE, KeepOptions
from nlpgrasp.pipeline.solve import check_json
from nlpgrasp.problem.identity import ProblemIdentity, problem_identity
from nlpgrasp.problem.problem import GraspProblem

# names of what a variation may replace
PROBLEM_FIELDS = tuple(f.name for f in fields(GraspProblem) if f.init)
OTHER_FIELDS = ("friction", "fingers", "starts", "options")
ALLOWED_FIELDS = f"fields of a GraspProblem ({', '.join(PROBLEM_FIELDS)}) or {', '.join(OTHER_FIELDS)}"


Changes: TypeAlias = Mapping[str, Any]
"""Replacements of a problem's fields, by name."""

Variation: TypeAlias = Changes | GraspProblem | Callable[[], Changes | GraspProblem]
"""Fields to replace, a whole problem, or a function that returns either."""


@dataclass(frozen=True)
class Experiment:
    """Base problem with named variations, each solved with several seeds.

    Parameters
    ----------
    base : GraspProblem
        Problem that the variations change.
    variations : mapping of str to mapping, GraspProblem or callable; or a sequence of such pairs
        By name, the fields of the base problem that are replaced. Besides the fields of
        ``GraspProblem`` these are known: ``friction`` (of all contacts), ``fingers`` (how many, where
        the base's contacts are alike), ``starts``, and ``options`` (``SolveOptions``, or a mapping
        of some of its fields). A whole problem replaces the base. A function without arguments that returns either is
        called in the worker that solves it: for hundreds of meshes that should not all be in memory.
        ``ng.combinations`` makes combinations of several factors.
    seeds : iterable of int
        Each variation is solved once with each seed.
    starts : int
        Of each solve.
    options : SolveOptions, optional
        ``workers`` is ignored: solves run in parallel, each in one process. So is ``rank``: variations and their starts
        are compared by mu.
    name : str, optional
        The base problem's when left out.
    keep, distinct : int, float
        For each solve, as in ``ng.solve``. A grasp taken from another variation is kept alone.

    Raises
    ------
    InputError
        On two variations of one name, and on invalid problems; only functions may fail later.
    """

    base: GraspProblem
    variations: Mapping[str, Variation] | Sequence[tuple[str, Variation]]
    seeds: Iterable[int] = (0,)
    starts: int = 8
    options: SolveOptions | None = None
    name: str | None = None
    keep: int = 1
    distinct: float = 0.1
    _base: Case = field(init=False, repr=False, compare=False)
    _by_name: dict[str, Variation] = field(init=False, repr=False, compare=False)
    _cases: dict[str, Case] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.base, GraspProblem):
            raise InputError("Experiment.base", self.base, "a GraspProblem")
        integer("Experiment.starts", self.starts, at_least=1, at_most=10**6)
        options = SolveOptions() if self.options is None else self.options
        if not isinstance(options, SolveOptions):
            raise InputError("Experiment.options", options, "a SolveOptions")
        base = Case(self.base, self.starts, replace(options, workers=1), KeepOptions(self.keep, self.distinct))
        object.__setattr__(self, "_base", base)
        object.__setattr__(self, "name", self.base.name if self.name is None else self.name)
        if not isinstance(self.name, str) or not self.name.strip() or not self.name.isprintable():
            raise InputError("Experiment.name", repr(self.name), "a text of printable characters")
        object.__setattr__(self, "seeds", check_seeds(self.seeds))
        self._set_variations()
        for variation, changes in self._by_name.items():
            if not callable(changes):
                case = create_case(f"Experiment.variations[{variation!r}]", base, changes)
                check_json(case.problem.to_dict())
                self._cases[variation] = case

    def _set_variations(self) -> None:
        variations = self.variations
        try:
            pairs = [(n, v) for n, v in (variations.items() if isinstance(variations, Mapping) else variations)]
        except (TypeError, ValueError):
            allowed = "a mapping, or a sequence of names and values"
            raise InputError("Experiment.variations", variations, allowed) from None
        check_names([name for name, _ in pairs])
        by_name = {n: freeze_changes(v) if isinstance(v, Mapping) else v for n, v in pairs}
        object.__setattr__(self, "variations", by_name)
        object.__setattr__(self, "_by_name", by_name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variations, in their order."""
        return tuple(self._by_name)

    @property
    def solves(self) -> tuple[SolveId, ...]:
        """Identifiers of all solves, grouped by variation.

        Workers keep the compiled programs of the last variation.
        """
        return tuple(SolveId(name, seed) for name in self.names for seed in self.seeds)

    def deferred(self, name: str) -> bool:
        """Return whether a variation is a function, which is called in the worker that solves it."""
        return name not in self._cases

    def case(self, name: str) -> Case:
        """Return problem and options of a variation.

        A deferred variation is created by this call.

        Raises
        ------
        InputError
            When the function of a deferred variation returns something that defines no problem.
        """
        return self.maker(name)()

    def maker(self, name: str) -> Callable[[], Case]:
        """Return a function that creates the case of a variation in a worker.

        The function does not refer to the rest of the experiment.
        """
        if self.deferred(name):
            return partial(create_case, f"Experiment.variations[{name!r}]", self._base, self._by_name[name])
        return partial(_return_case, self._cases[name])


@dataclass(frozen=True, order=True)
class SolveId:
    """Identifier of one solve: variation and seed.

    Parameters
    ----------
    variation : str
    seed : int
    """

    variation: str
    seed: int

    def __str__(self) -> str:
        return f"{self.variation}, seed {self.seed}"


def check_names(names: Sequence[object]) -> None:
    """Raise if names of variations cannot be displayed or distinguished."""
    if not names:
        raise InputError("Experiment.variations", "none", "at least one variation")
    for name in names:
        if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 200:
            raise InputError("Experiment.variations", repr(name), "names of 1 to 200 printable characters")
    repeated = [name for name, count in Counter(" ".join(str(n).split()) for n in names).items() if count > 1]
    if repeated:
        raise InputError("Experiment.variations", f"two variations named {repeated[0]!r}", "each name once")


def check_seeds(seeds: object) -> tuple[int, ...]:
    """Return validated integer seeds.

    Raises
    ------
    InputError
        On an empty list, values other than integers, or a repeated seed.
    """
    try:
        if isinstance(seeds, str) or not isinstance(seeds, Iterable):
            raise TypeError
        values = tuple(seeds)
    except TypeError:
        raise InputError("Experiment.seeds", seeds, "whole numbers") from None
    checked = tuple(integer("Experiment.seeds", s, at_least=0, at_most=10**15) for s in values)
    if not checked or len(set(checked)) < len(checked):
        raise InputError("Experiment.seeds", list(checked), "at least one whole number, none twice")
    return checked


def _return_case(case: Case) -> Case:
    """Return the given case; with ``partial``, a picklable case function.

    A lambda could not be sent to a worker.
    """
    return case


@dataclass(frozen=True)
class Case:
    """One variation: a problem with solve options.

    Parameters
    ----------
    problem : GraspProblem
    starts : int
    options : SolveOptions
        With one worker: an experiment parallelises over solves, not starts.
    keeping : KeepOptions
    digest : str
        Of the case's identity, where a solve states it.
    """

    problem: GraspProblem
    starts: int
    options: SolveOptions
    keeping: KeepOptions = ONE
    digest: str = ""

    @property
    def _settings(self) -> CaseData:
        options = {k: v for k, v in self.options.to_dict().items() if k != "workers"}
        data: CaseData = {"starts": self.starts, "options": options}
        if self.keeping.count == 1:
            return data
        return {**data, "keep": self.keeping.count, "distinct": self.keeping.distinct}

    def identity(self) -> ProblemIdentity:
        """Return what determines the case's result, beside the seed."""
        return problem_identity(self.problem, cast("Json", self._settings))

    def to_dict(self) -> CaseData:
        """Return problem and settings as JSON data."""
        problem = {"name": self.problem.name, "torque_origin": self.problem.origin.tolist(), **self.problem.to_dict()}
        return {"problem": problem, **self._settings}


class CaseData(TypedDict, total=False):
    """JSON data of one variation.

    A variation that a function creates has the entry ``deferred`` alone.
    """

    deferred: bool
    digest: str
    problem: Json
    starts: int
    options: Json
    keep: int
    distinct: float


def create_case(field: str, base: Case, variation: Variation) -> Case:
    """Create the case of a variation from the base case.

    Parameters
    ----------
    field : str
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
        raise InputError(field, variation, "a mapping, a GraspProblem, or a function that returns one")
    changes = variation() if callable(variation) else variation
    if isinstance(changes, GraspProblem):
        return replace(base, problem=changes)
    if not isinstance(changes, Mapping):
        raise InputError(
            field, changes, "a mapping of fields to values, a GraspProblem, or a function returning either"
        )
    check_fields(field, changes)
    # a task stated without a torque origin is about that of each variation
    stated = {"task": base.problem.stated_task, **changes}
    parts = {name: value for name, value in stated.items() if name in PROBLEM_FIELDS}
    try:
        problem = replace(base.problem, **_apply_fingers(base.problem, changes, parts))
    except InputError as error:
        raise InputError(f"{field}: {error.field}", error.given, error.allowed) from None
    starts = integer(f"{field}.starts", changes.get("starts", base.starts), at_least=1, at_most=10**6)
    return Case(problem, starts, _merge_base_options(field, base.options, changes.get("options")), base.keeping)


def freeze_changes(changes: Changes) -> Changes:
    """Return changes in which a generator of constraints is replaced by a tuple, which can be read repeatedly."""
    constraints = changes.get("constraints")
    return {**changes, "constraints": tuple(constraints)} if isinstance(constraints, Iterator) else changes


def check_fields(field: str, changes: Changes) -> None:
    """Raise if a changed name is not a field that a variation can replace."""
    unknown = [name for name in changes if name not in (*PROBLEM_FIELDS, *OTHER_FIELDS)]
    if unknown:
        raise InputError(f"{field}.{unknown[0]}", "a field that does not exist", ALLOWED_FIELDS)


def _apply_fingers(base: GraspProblem, changes: Changes, parts: Changes) -> Changes:
    """Return the changed fields, with ``fingers`` and ``friction`` turned into contacts and hand."""
    if "fingers" not in changes and "friction" not in changes:
        return parts
    if "contacts" in parts:
        raise InputError("contacts", "contacts together with fingers or friction", "one or the other")
    models = base.models
    if "fingers" in changes:
        count = integer("fingers", changes["fingers"], at_least=1)
        if any(model != models[0] for model in models):
            raise InputError("fingers", count, "a base problem whose contacts are all alike, or contacts")
        models = models[:1] * count
        hand = parts.get("hand", base.hand)
        if isinstance(hand, Fingertips) and "hand" not in parts:
            parts = {**parts, "hand": replace(hand, count=count)}
    if "friction" in changes:
        friction = number("friction", changes["friction"], above=0.0)
        models = tuple(_apply_friction(model, friction) for model in models)
    return {**parts, "contacts": models}


def _apply_friction(model: ContactModel, friction: float) -> ContactModel:
    """Return a contact model with another friction coefficient."""
    if "friction" not in {field.name for field in fields(model)}:
        raise InputError("friction", f"a base problem with a {type(model).__name__}", "contacts with friction")
    return model.with_coefficients(friction=friction)


def _merge_base_options(field: str, base: SolveOptions, changes: object) -> SolveOptions:
    """Return the solver options of a variation: new ones, or the base options with some replaced."""
    if changes is None:
        return base
    if isinstance(changes, SolveOptions):
        return replace(changes, workers=1)
    names = set(base.to_dict()) - {"workers"}
    if not isinstance(changes, Mapping) or not set(changes) <= names:
        raise InputError(f"{field}.options", changes, "an ng.SolveOptions, or a mapping of some of its fields")
    return replace(base, **changes)


def combinations(*factors: Mapping[str, Changes], choose: Callable[..., bool] | None = None) -> dict[str, Changes]:
    """Return all combinations of the factors' levels as variations, named ``"level, level"``.

    Constraints of several factors are concatenated, and mappings of different options merged; any other field may come
    from one factor only.

    Parameters
    ----------
    *factors : mapping of str to mapping
        Levels by name, each with the fields that it replaces. ``{}`` changes nothing.
    choose : callable, optional
        Predicate of the levels' names, in the order of the factors, that selects combinations; all when left out.

    Raises
    ------
    InputError
        On factors that are not mappings of fields, fields from two factors, or when nothing is chosen.

    Examples
    --------
    >>> from nlpgrasp import combinations
    >>> list(combinations({"rough": {"friction": 0.8}, "smooth": {"friction": 0.2}}, {"3": {"fingers": 3}, "4": {}}))
    ['rough, 3', 'rough, 4', 'smooth, 3', 'smooth, 4']
    """
    if not factors:
        raise InputError("combinations", "no factors", "at least one mapping of names to fields")
    if choose is not None and not callable(choose):
        raise InputError("choose", choose, "a function of the levels' names")
    for i, factor in enumerate(factors):
        _check_factor(f"combinations: factor {i}", factor)
    frozen = [{name: freeze_changes(changes) for name, changes in factor.items()} for factor in factors]
    result: dict[str, Changes] = {}
    for levels in product(*frozen):
        if choose is None or _is_chosen(choose, levels):
            name = ", ".join(levels)
            if name in result:
                raise InputError("combinations", f"two combinations named {name!r}", "level names without commas")
            result[name] = _merge_levels(name, [factor[level] for factor, level in zip(frozen, levels, strict=True)])
    if not result:
        raise InputError("choose", "no combination", "a function that keeps at least one")
    return result


def _check_factor(field: str, factor: Mapping[str, Changes]) -> None:
    """Raise if a factor is not a mapping of level names to changed fields."""
    if not isinstance(factor, Mapping) or not factor:
        raise InputError(field, factor, "a mapping of level names to fields, not empty")
    for name, changes in factor.items():
        if not isinstance(name, str) or not isinstance(changes, Mapping):
            raise InputError(f"{field}[{name!r}]", changes, "a mapping of fields to values, named by a text")
        check_fields(f"{field}[{name!r}]", changes)


def _merge_levels(name: str, levels: list[Changes]) -> Changes:
    """Return the merged changes of one level per factor."""
    result: dict[str, object] = {}
    for changes in levels:
        for field_name, value in changes.items():
            if field_name not in result:
                result[field_name] = value
            elif field_name == "constraints":
                result[field_name] = (*_as_tuple(result[field_name]), *_as_tuple(value))
            elif field_name == "options" and (merged_options := _merge_options(result[field_name], value)) is not None:
                result[field_name] = merged_options
            else:
                path = f"combinations[{name!r}].{field_name}"
                raise InputError(path, "values of two factors", "values of one factor")
    return result


def _merge_options(first: object, second: object) -> dict[str, object] | None:
    """Merge two mappings of solver options; return ``None`` if either is no mapping or they share an option."""
    if isinstance(first, Mapping) and isinstance(second, Mapping) and not set(first) & set(second):
        return {**first, **second}
    return None


def _is_chosen(choose: Callable[..., bool], levels: tuple[str, ...]) -> bool:
    """Return whether the user's function keeps a combination of levels."""
    try:
        return bool(choose(*levels))
    except TypeError as error:
        raise InputError("choose", error_line(error), f"a function of {len(levels)} names") from None


def _as_tuple(constraints: object) -> tuple[object, ...]:
    """Return one or several constraints as a tuple."""
    return tuple(constraints) if isinstance(constraints, list | tuple) else (constraints,)
