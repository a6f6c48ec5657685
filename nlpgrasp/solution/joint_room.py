"""Joint-limit margins of a grasp's hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nlpgrasp.common.types import Json

SMALL = 1e-6  # relative tolerance of a margin
WORTH_A_WORD = 0.005  # share of mu above which the cost of margins is reported


@dataclass(frozen=True)
class JointRoom:
    """Distances of joints from their limits, against required margins.

    Parameters
    ----------
    margin : float
        The requested margin, radians.
    margins : mapping of str to float
        Margin of each free joint: at most a tenth of its range. Radians, metres for sliding joints.
    left : mapping of str to float
        Distance of each of them from its nearer limit.
    price : float
        Largest share of mu that might be traded for the margins.
    """

    margin: float
    margins: Mapping[str, float]
    left: Mapping[str, float]
    price: float

    @property
    def near(self) -> dict[str, float]:
        """Distance from the nearer limit, for the joints that lack their margin."""
        least = {name: (1.0 - SMALL) * margin for name, margin in self.margins.items()}
        return {name: left for name, left in self.left.items() if left < least[name]}

    def to_dict(self) -> Json:
        """Return the margins as JSON data."""
        return {"margin": self.margin, "margins": dict(self.margins), "near": self.near, "price": self.price}


def mu_without(stated: Json) -> float:
    """Return the mu before the search for joint-limit margins, from a file of an earlier version; 0 in later ones."""
    without = stated.get("mu_without")
    return 0.0 if without is None else float(without["upper"])


def room_lines(stated: Json) -> list[str]:
    """Return as text which joints are near a limit, of ``hand.room``, and what earlier versions gave for margins."""
    told = []
    if stated["near"]:
        each = (f"{name} ({left:.2g} of {stated['margins'][name]:.2g})" for name, left in stated["near"].items())
        told.append("joints near a limit: " + ", ".join(each))
    if stated.get("cost", 0.0) > WORTH_A_WORD:
        told.append(f"room to the joints' limits took {stated['cost']:.1%} of mu")
    return told
