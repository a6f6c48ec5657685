"""What is found out after a solve: how robust the grasp is, and why there is no grasp."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from nlpgrasp.common.validation import FloatArray, array, integer
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.schema.types import ConflictData, RobustData, WhyNotData

FRAGILE = 0.2  # share of mu: where less is left, the task takes more than five times the force once contacts slip
LEAST_SHARE = 1e-4  # shares below are all said alike


@dataclass(frozen=True)
class Robustness:
    """The quality left when contacts are off and friction is less, at the worst placement found.

    Parameters
    ----------
    offset : float
        How far each contact may be off along its face, metres.
    friction_share : float
        Share by which friction and torsional friction may be less.
    mu : Bounds
        Certified, of the worst placement found with the least friction: its upper bound is one on the worst there is.
    points, normals : (k, space) array
        That placement: contacts, metres, and unit inward normals, body frame.
    lost : tuple of int
        Contacts that slip over an edge of their face: they press nothing, and are stated where they were.
    stated : tuple or None
        What the solution says of the share of mu that is left, and whether the grasp is fragile; None in files of
        earlier versions.
    """

    offset: float
    friction_share: float
    mu: Bounds
    points: FloatArray
    normals: FloatArray
    lost: tuple[int, ...] = ()
    stated: tuple[float, bool] | None = field(default=None, repr=False, compare=False)

    def share(self, mu: Bounds) -> float:
        """Return how much is left of a grasp's certified quality, as a share: of both, the upper bound."""
        return min(self.mu.upper / mu.upper, 1.0) if mu.upper > 0.0 else 0.0

    def is_fragile(self, mu: Bounds) -> bool:
        """Return whether less than a fifth of a grasp's certified quality is left (``FRAGILE``)."""
        return self.share(mu) < FRAGILE

    def fragile_words(self, mu: Bounds, label: str) -> str:
        """Return how fragile a grasp of this certified quality is, a measure of this name."""
        share = self.share(mu)
        little = f"less than {100.0 * LEAST_SHARE:g} %" if share > 0.0 else "nothing"
        left = f"{100.0 * share:.2g} %" if share >= LEAST_SHARE else little
        off = f"contacts are {1e3 * self.offset:g} mm off and friction {100.0 * self.friction_share:g} % less"
        return f"fragile: {left} of {label} is left when {off}"

    def beside(self, mu: Bounds) -> Robustness:
        """Return the finding with what it says of a grasp of this certified quality."""
        return replace(self, stated=(self.share(mu), self.is_fragile(mu)))

    def to_dict(self) -> RobustData:
        """Return the finding as JSON data."""
        data: RobustData = {
            "offset": self.offset,
            "friction_share": self.friction_share,
            "mu": self.mu.to_dict(),
            "positions": self.points.tolist(),
            "normals": self.normals.tolist(),
        }
        if self.lost:
            data["lost"] = list(self.lost)
        if self.stated is not None:
            data["share"], data["fragile"] = self.stated
        return data

    @classmethod
    def from_dict(cls, data: RobustData, name: str) -> Robustness:
        """Return the finding that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When its interval is empty or its arrays do not fit each other; ``name`` is shown in the message.
        """
        bounds = Bounds.from_dict(data["mu"], f"{name}.mu")
        points = array(f"{name}.positions", data["positions"], (None, None))
        normals = array(f"{name}.normals", data["normals"], points.shape)
        stated = (data["share"], data["fragile"]) if "share" in data and "fragile" in data else None
        lost = tuple(integer(f"{name}.lost", i, at_least=0, at_most=len(points) - 1) for i in data.get("lost", ()))
        return cls(data["offset"], data["friction_share"], bounds, points, normals, lost, stated)

    def __str__(self) -> str:
        off = f"contacts {1e3 * self.offset:g} mm off and {self.friction_share:.0%} less friction"
        slipped = f"; {len(self.lost)} slip over an edge" if self.lost else ""
        return f"with {off}, {self.mu} is left (worst case found{slipped})"


@dataclass(frozen=True)
class Conflict:
    """A constraint that could not be kept with the others.

    Parameters
    ----------
    name : str
        The constraint.
    row : str
        Its row that is broken most.
    value, bound : float
        What the row is in the nearest miss, and its limit.
    relation : {"at least", "at most", "exactly"}
        What the value should be to the bound.
    unit : {"", "m", "degrees"}
    """

    name: str
    row: str
    value: float
    bound: float
    relation: str
    unit: str = ""

    def to_dict(self) -> ConflictData:
        """Return the conflict as JSON data."""
        return {
            "name": self.name,
            "row": self.row,
            "value": self.value,
            "bound": self.bound,
            "relation": self.relation,
            "unit": self.unit,
        }

    @classmethod
    def from_dict(cls, data: ConflictData) -> Conflict:
        """Return the conflict that ``to_dict`` wrote."""
        return cls(**data)

    @property
    def excess(self) -> float:
        """How far the value is beyond the bound."""
        return abs(self.value - self.bound)

    @property
    def amount(self) -> str:
        """The excess with its unit, lengths in millimetres."""
        return self._text(self.excess, 3)

    def __str__(self) -> str:
        return f"{self.row}: {self._text(self.value, 4)}, wanted {self.relation} {self._text(self.bound, 4)}."

    def _text(self, value: float, digits: int) -> str:
        scale, unit = (1e3, " mm") if self.unit == "m" else (1.0, f" {self.unit}" if self.unit else "")
        return f"{scale * value:.{digits}g}{unit}"


@dataclass(frozen=True)
class WhyNot:
    """Why no grasp was found.

    Parameters
    ----------
    conflicts : tuple of Conflict
        A least set of constraints that had to be broken; empty where all can be kept.
    direction : (d,) array or None
        Where the constraints can be kept: a direction y of wrench space along which no finger force works.
    reasons, advice : tuple of str
        Sentences.
    locally_infeasible : bool
        Whether the constraints could not be kept from any start.
    """

    conflicts: tuple[Conflict, ...] = ()
    direction: FloatArray | None = None
    reasons: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    locally_infeasible: bool = False

    def to_dict(self) -> WhyNotData:
        """Return the diagnosis as JSON data."""
        return {
            "conflicts": [conflict.to_dict() for conflict in self.conflicts],
            "direction": None if self.direction is None else self.direction.tolist(),
            "reasons": list(self.reasons),
            "advice": list(self.advice),
            "locally_infeasible": self.locally_infeasible,
        }

    @classmethod
    def from_dict(cls, data: WhyNotData) -> WhyNot:
        """Return the diagnosis that ``to_dict`` wrote."""
        return cls(
            tuple(Conflict.from_dict(conflict) for conflict in data["conflicts"]),
            None if data["direction"] is None else np.array(data["direction"], dtype=float),
            tuple(data["reasons"]),
            tuple(data["advice"]),
            data["locally_infeasible"],
        )

    def __str__(self) -> str:
        return "\n".join([*self.reasons, *self.advice])
