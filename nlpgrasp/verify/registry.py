"""Registries of numeric models, with ``register_body``, ``register_constraint`` and ``register_hand``.

A counterpart restates in numpy, from JSON data alone, the CasADi expressions that the kind gives to the solver; the two
share no code. A new kind is registered in one line, also from outside the package::

    from nlpgrasp.verify import ConstraintValue, register_constraint

    def ceiling(data, placement):
        for i, p in enumerate(placement.points):
            yield ConstraintValue(f"ceiling, finger {i}", p[2], upper=data["height"], scale=placement.size)

    register_constraint("ceiling", ceiling)

A body or constraint that is registered for files, and has no counterpart, is recomputed by its own functions at the
numbers of the file (``own_functions``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Generic, TypeVar

from nlpgrasp.common.types import Json
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.own_functions import body_functions, constraint_functions
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import ConstraintValue, NumericBody, NumericHand, StatedPlacement

Counterpart = TypeVar("Counterpart")
BodyCounterpart = Callable[[Json, SourceFolders], NumericBody]
"""Function of ``problem.body`` and the folders of files to the numeric body."""
ConstraintCounterpart = Callable[[Json, StatedPlacement], Iterable[ConstraintValue]]
"""Function of one of ``problem.constraints`` and the placement to its scalar constraints, in their order."""
HandCounterpart = Callable[[Json, Json, Mapping[str, float], SourceFolders], NumericHand]
"""Function of ``problem.hand``, ``hand``, the stated values of constraints by name, and the folders of files."""


class CounterpartRegistry(Generic[Counterpart]):
    """Registry of functions that build numeric models, by the JSON type of the modelled kind.

    Parameters
    ----------
    what : str
        What they are counterparts of, for messages.
    otherwise : callable, optional
        Function of a kind without a counterpart to a numeric model by its own functions, or None.
    """

    def __init__(self, what: str, otherwise: Callable[[str], Counterpart | None] = lambda kind: None) -> None:
        self._what, self._otherwise = what, otherwise
        self._counterparts: dict[str, Counterpart] = {}

    def register(self, kind: str, counterpart: Counterpart) -> None:
        """Register the numeric model of a kind, in place of an earlier one."""
        self._counterparts[kind] = counterpart

    def of(self, data: Json) -> Counterpart:
        """Return the numeric model for the ``type`` of JSON data; raise ``NotCheckedError`` if there is none."""
        kind = data.get("type")
        counterpart = self._counterparts.get(str(kind)) or self._otherwise(str(kind))
        if counterpart is None:
            raise NotCheckedError(f"nothing recomputes a {self._what} of type {kind!r}")
        return counterpart

    @property
    def kinds(self) -> tuple[str, ...]:
        """The registered types."""
        return tuple(self._counterparts)


BODIES: CounterpartRegistry[BodyCounterpart] = CounterpartRegistry("body", body_functions)
CONSTRAINTS: CounterpartRegistry[ConstraintCounterpart] = CounterpartRegistry("constraint", constraint_functions)
HANDS: CounterpartRegistry[HandCounterpart] = CounterpartRegistry("hand")
register_body, register_constraint, register_hand = BODIES.register, CONSTRAINTS.register, HANDS.register
