"""Combinations of factor levels into variations: full or filtered factorial design."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.variation import Changes, check_fields, settled_changes


def combinations(*factors: Mapping[str, Changes], choose: Callable[..., bool] | None = None) -> dict[str, Changes]:
    """Return variations that combine one level of each factor, named ``"level, level"``.

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
        _check(f"combinations: factor {i}", factor)
    settled = [{name: settled_changes(changes) for name, changes in factor.items()} for factor in factors]
    result: dict[str, Changes] = {}
    for levels in product(*settled):
        if choose is None or _chosen(choose, levels):
            name = ", ".join(levels)
            if name in result:
                raise InputError("combinations", f"two combinations named {name!r}", "level names without commas")
            result[name] = _merged(name, [factor[level] for factor, level in zip(settled, levels, strict=True)])
    if not result:
        raise InputError("choose", "no combination", "a function that keeps at least one")
    return result


def _check(where: str, factor: Mapping[str, Changes]) -> None:
    if not isinstance(factor, Mapping) or not factor:
        raise InputError(where, factor, "a mapping of level names to fields, not empty")
    for name, changes in factor.items():
        if not isinstance(name, str) or not isinstance(changes, Mapping):
            raise InputError(f"{where}[{name!r}]", changes, "a mapping of fields to values, named by a text")
        check_fields(f"{where}[{name!r}]", changes)


def _merged(name: str, levels: list[Changes]) -> Changes:
    result: dict[str, object] = {}
    for changes in levels:
        for field, value in changes.items():
            if field not in result:
                result[field] = value
            elif field == "constraints":
                result[field] = (*_several(result[field]), *_several(value))
            elif field == "options" and (both := _joined(result[field], value)) is not None:
                result[field] = both
            else:
                raise InputError(f"combinations[{name!r}].{field}", "values of two factors", "values of one factor")
    return result


def _joined(one: object, other: object) -> dict[str, object] | None:
    """Return the merged mappings of options; None unless both are mappings with different options."""
    if isinstance(one, Mapping) and isinstance(other, Mapping) and not set(one) & set(other):
        return {**one, **other}
    return None


def _chosen(choose: Callable[..., bool], levels: tuple[str, ...]) -> bool:
    try:
        return bool(choose(*levels))
    except TypeError as error:
        raise InputError("choose", one_line(error), f"a function of {len(levels)} names") from None


def _several(constraints: object) -> tuple[object, ...]:
    """Return constraints as a tuple; a single one is allowed."""
    return tuple(constraints) if isinstance(constraints, list | tuple) else (constraints,)
