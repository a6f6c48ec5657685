"""The room that the joints of a grasp's hand have to their limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nlpgrasp.common.types import Json

SMALL = 1e-6  # of a margin: what a joint may lack of it
WORTH_A_WORD = 0.005  # share of mu


@dataclass(frozen=True)
class JointRoom:
    """How far joints are from their limits.

    Parameters
    ----------
    margin : float
        That was asked for, radians.
    margins : mapping of str to float
        What each free joint is to have of it: a tenth of its range at most. Radians, metres of sliding joints.
    left : mapping of str to float
        Distance of each of them from its nearer limit.
    price : float
        Share of mu that might be given for it.
    """

    margin: float
    margins: Mapping[str, float]
    left: Mapping[str, float]
    price: float

    @property
    def near(self) -> dict[str, float]:
        """Distance from the nearer limit of the joints that have less than their margin."""
        least = {name: (1.0 - SMALL) * margin for name, margin in self.margins.items()}
        return {name: left for name, left in self.left.items() if left < least[name]}

    def to_dict(self) -> Json:
        """Return it as JSON data."""
        return {"margin": self.margin, "margins": dict(self.margins), "near": self.near, "price": self.price}


def mu_without(stated: Json) -> float:
    """Return the mu that a grasp of an earlier version states it had before its joints got room; 0 of later ones."""
    without = stated.get("mu_without")
    return 0.0 if without is None else float(without["upper"])


def room_lines(stated: Json) -> list[str]:
    """Return in words which joints are near a limit, of ``hand.room``, and what of mu earlier versions gave for it."""
    told = []
    if stated["near"]:
        each = (f"{name} ({left:.2g} of {stated['margins'][name]:.2g})" for name, left in stated["near"].items())
        told.append("joints near a limit: " + ", ".join(each))
    if stated.get("cost", 0.0) > WORTH_A_WORD:
        told.append(f"room to the joints' limits took {stated['cost']:.1%} of mu")
    return told
