"""Owner and scale of stated constraints that cannot be recomputed, by their names."""

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


ON_TIP_LENGTHS = (", x", ", y", ", z", ", plane", ", extent x", ", extent y")  # endings of lengths on a fingertip
OF_CONSTRAINTS = ("table, ", "workspace, ", "symmetric, ", "forbidden region, ")
LENGTHS = (*OF_CONSTRAINTS, f"{CLEARANCE}, ", f"{EDGE_MARGIN}, ", f"{ROOM}, ")
SQUARED_SPANS = (f"{TIPS_APART}, ", f"{SELF_COLLISION}, ")  # for hands with links; free fingertips are recomputed


@dataclass(frozen=True)
class Scales:
    """Scales of stated constraints by their names, for relative tolerances.

    Parameters
    ----------
    size : float
        The body's characteristic length, metres.
    span : float
        Reach of the hand from its palm, metres.
    obstacles : tuple of str
        Names of the problem's obstacles.
    """

    size: float
    span: float
    obstacles: tuple[str, ...] = ()

    def of(self, name: str) -> float:
        """Return the scale of a constraint, in its own unit: metres, square metres, or 1 for a cosine."""
        if name.startswith(SQUARED_SPANS):
            return self.span**2
        if name.startswith(f"{ON_FINGERTIP} "):
            return self.size if name.endswith(ON_TIP_LENGTHS) else 1.0
        lengths = (*LENGTHS, *(f"{obstacle}, " for obstacle in self.obstacles))
        return self.size if name.startswith(lengths) else 1.0


def constraint_owner(data: Json, contacts: int) -> Owner:
    """Return the predicate of scalar constraints that a constraint may own; any for another package's."""
    kind = str(data["type"])
    if kind == "obstacle":
        return _beginning((f"{data['name']}, ",), contacts)
    if kind == "expression":
        elements = re.compile(re.escape(str(data["name"])) + r"(?:\[\d+\])?")
        return lambda row: elements.fullmatch(row) is not None
    return _beginning((CONSTRAINTS[kind],), contacts) if kind in CONSTRAINTS else anything


def hand_owner(data: Json, contacts: int) -> Owner:
    """Return the predicate of scalar constraints that a hand may own; any for another package's."""
    kind = str(data["type"])
    return _beginning(HANDS[kind], contacts) if kind in HANDS else anything


def links_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the links of a hand may own."""
    return _beginning(LINKS, contacts)


def margin_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the margin from sharp edges may own."""
    return _beginning((f"{EDGE_MARGIN}, ",), contacts)


def room_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the clearance of fingertips may own."""
    return _beginning((f"{ROOM}, ",), contacts)


def anything(row: str) -> bool:
    """Return True: parts of other packages may own any scalar constraint."""
    return True


def _beginning(first: tuple[str, ...], contacts: int) -> Owner:
    """Return the predicate of names with such a beginning and existing contacts."""
    return lambda row: row.startswith(first) and all(int(i) < contacts for i in FINGER.findall(row))
