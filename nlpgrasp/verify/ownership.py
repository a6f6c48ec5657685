"""Names of stated constraints that could not be recomputed: the part of the problem they belong to, and their scale."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from nlpgrasp.common.rows import CLEARANCE, EDGE_MARGIN, ON_FINGERTIP, ROOM, SELF_COLLISION, TIPS_APART, UNIT_QUATERNION
from nlpgrasp.common.types import Json

Owner = Callable[[str], bool]
"""Whether a part may own a row of this name."""

CONSTRAINTS = {
    "table": "table, ",
    "spread": "spread, ",
    "workspace": "workspace, ",
    "forbid": "forbidden region, ",
    "symmetric": "symmetric, ",
    "approach": "approach, ",
}
"""How the rows of the package's constraints begin."""
HANDS = {
    "urdf": (f"{ON_FINGERTIP} ", UNIT_QUATERNION, f"{TIPS_APART}, "),
    "fingertips": ("reach, ", f"{TIPS_APART}, "),
    "parallel_jaw": ("opening of the jaws", "opposed jaws", "facing, "),
}
LINKS = (f"{CLEARANCE}, ", f"{SELF_COLLISION}, ")
FINGER = re.compile(r"(?:finger|fingers|and) (\d+)(?=,| and |$)")


ON_TIP_LENGTHS = (", x", ", y", ", z", ", plane", ", extent x", ", extent y")  # coordinates on a fingertip
OF_CONSTRAINTS = ("table, ", "workspace, ", "symmetric, ", "forbidden region, ")
LENGTHS = (*OF_CONSTRAINTS, f"{CLEARANCE}, ", f"{EDGE_MARGIN}, ", f"{ROOM}, ")
SQUARED_SPANS = (f"{TIPS_APART}, ", f"{SELF_COLLISION}, ")  # of a hand with links; those of free tips are recomputed


@dataclass(frozen=True)
class Scales:
    """Typical sizes of stated constraints by their names: tolerances are relative to them.

    Parameters
    ----------
    size : float
        The body's characteristic length, metres.
    span : float
        How far the hand reaches from its palm, metres.
    obstacles : tuple of str
        Names of the problem's obstacles.
    """

    size: float
    span: float
    obstacles: tuple[str, ...] = ()

    def of(self, name: str) -> float:
        """Return the typical size of a constraint, in its own unit: metres, square metres, or 1 of a cosine."""
        if name.startswith(SQUARED_SPANS):
            return self.span**2
        if name.startswith(f"{ON_FINGERTIP} "):
            return self.size if name.endswith(ON_TIP_LENGTHS) else 1.0
        lengths = (*LENGTHS, *(f"{obstacle}, " for obstacle in self.obstacles))
        return self.size if name.startswith(lengths) else 1.0


def constraint_owner(data: Json, contacts: int) -> Owner:
    """Return which rows a constraint may own; one of another package any row."""
    kind = str(data["type"])
    if kind == "obstacle":
        return _beginning((f"{data['name']}, ",), contacts)
    if kind == "expression":
        elements = re.compile(re.escape(str(data["name"])) + r"(?:\[\d+\])?")
        return lambda row: elements.fullmatch(row) is not None
    return _beginning((CONSTRAINTS[kind],), contacts) if kind in CONSTRAINTS else anything


def hand_owner(data: Json, contacts: int) -> Owner:
    """Return which rows a hand may own; one of another package any row."""
    kind = str(data["type"])
    return _beginning(HANDS[kind], contacts) if kind in HANDS else anything


def links_owner(contacts: int) -> Owner:
    """Return which rows the links of a hand may own."""
    return _beginning(LINKS, contacts)


def margin_owner(contacts: int) -> Owner:
    """Return which rows the margin from sharp edges may own."""
    return _beginning((f"{EDGE_MARGIN}, ",), contacts)


def room_owner(contacts: int) -> Owner:
    """Return which rows the room for fingertips may own."""
    return _beginning((f"{ROOM}, ",), contacts)


def anything(row: str) -> bool:
    """Return that a part of another package, of which nothing is known, may own any row."""
    return True


def _beginning(first: tuple[str, ...], contacts: int) -> Owner:
    """Return whether a row begins so and is about contacts that there are."""
    return lambda row: row.startswith(first) and all(int(i) < contacts for i in FINGER.findall(row))
