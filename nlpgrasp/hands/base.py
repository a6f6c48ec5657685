"""What every hand states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from nlpgrasp.rows import Placement, Row
from nlpgrasp.validation import FloatArray

Expression = Any  # casadi.SX


@dataclass(frozen=True)
class HandVariable:
    """A variable a hand adds to the program.

    Parameters
    ----------
    name : str
    lower, upper : (m,) array
        Limits, in the hand's units.
    scale : float
        Typical size, for the solver's scaling.
    """

    name: str
    lower: FloatArray
    upper: FloatArray
    scale: float = 1.0


class Hand(ABC):
    """A hand: what it can reach, with one fingertip a contact, in the order of the contacts.

    Attributes
    ----------
    count : int
        Number of fingertips.
    """

    count: int

    @property
    @abstractmethod
    def tip_radius(self) -> float:
        """Radius of the fingertips, metres; 0 for points."""

    @abstractmethod
    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return the variables the hand adds, given the body's bounding box (2, space)."""

    @abstractmethod
    def start(self, tips: FloatArray) -> dict[str, FloatArray]:
        """Return starting values of the variables for fingertip centres (k, space)."""

    @abstractmethod
    def rows(self, placement: Placement, variables: dict[str, Expression]) -> list[Row]:
        """Return the rows the hand adds to the program."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the hand as JSON data."""
