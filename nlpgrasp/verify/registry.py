"""Registry of numeric counterparts for bodies, constraints and hands.

A counterpart restates in numpy, from JSON data alone, the CasADi expressions that the kind gives to the solver; the two
share no code. A new kind is registered in one line, also from outside the package::

    from nlpgrasp.verify import RowValue, register_constraint

    def ceiling(data, placement):
        for i, p in enumerate(placement.points):
            yield RowValue(f"ceiling, finger {i}", p[2], upper=data["height"], scale=placement.size)

    register_constraint("ceiling", ceiling)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Generic, TypeVar

from nlpgrasp.common.types import Json
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import ConstraintValue, HandNumbers, NumericBody, StatedPlacement

Twin = TypeVar("Twin")
BodyTwin = Callable[[Json, SourceFolders], NumericBody]
"""``problem.body`` and where files are looked for, to the body's numbers."""
ConstraintTwin = Callable[[Json, StatedPlacement], Iterable[ConstraintValue]]
"""One of ``problem.constraints`` and the placement, to the rows that it gives, in their order."""
HandTwin = Callable[[Json, Json, Mapping[str, float], SourceFolders], HandNumbers]
"""``problem.hand``, ``hand``, the stated values of the rows by name, and where files are looked for."""


class CounterpartRegistry(Generic[Twin]):
    """Numeric counterparts by the JSON type of their kind.

    Parameters
    ----------
    what : str
        What they are counterparts of, for messages.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._known: dict[str, Twin] = {}

    def register(self, kind: str, twin: Twin) -> None:
        """Add the counterpart of a kind; a later one replaces an earlier one."""
        self._known[kind] = twin

    def of(self, data: Json) -> Twin:
        """Return the counterpart for JSON data with a ``type``; raise ``NotCheckedError`` where there is none."""
        kind = data.get("type")
        twin = self._known.get(str(kind))
        if twin is None:
            raise NotCheckedError(f"nothing recomputes a {self._what} of type {kind!r}")
        return twin

    @property
    def kinds(self) -> tuple[str, ...]:
        """The registered types."""
        return tuple(self._known)


BODIES: CounterpartRegistry[BodyTwin] = CounterpartRegistry("body")
CONSTRAINTS: CounterpartRegistry[ConstraintTwin] = CounterpartRegistry("constraint")
HANDS: CounterpartRegistry[HandTwin] = CounterpartRegistry("hand")
register_body, register_constraint, register_hand = BODIES.register, CONSTRAINTS.register, HANDS.register
