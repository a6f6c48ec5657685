"""Wrenches of a solution with the finger forces that produce them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.solution.schema.types import ForcesData

Forces: TypeAlias = Sequence[tuple[FloatArray, FloatArray]]  # (wrench, forces) pairs
Moments: TypeAlias = Sequence[FloatArray]  # moments for each wrench, or empty


@dataclass(frozen=True)
class HeldWrench:
    """A wrench and the least finger forces that produce it.

    Parameters
    ----------
    wrench : (d,) array
    forces : (k, space) array
        Body frame, newtons.
    moments : (k, d - space) array or None
        About the contact points, newton-metres; None where no contact exerts any.
    """

    wrench: FloatArray
    forces: FloatArray
    moments: FloatArray | None = None

    def to_dict(self) -> ForcesData:
        """Return wrench, forces and, where there are any, moments as JSON data."""
        data: ForcesData = {"direction": self.wrench.tolist(), "forces": self.forces.tolist()}
        if self.moments is not None:
            data["moments"] = self.moments.tolist()
        return data

    @classmethod
    def from_dict(cls, data: ForcesData, name: str) -> HeldWrench:
        """Return the record that ``to_dict`` wrote; refuse arrays of other dimensions, under this name."""
        wrench = array(f"{name}: direction", data["direction"], (None,))
        forces = array(f"{name}: forces", data["forces"], (None, None))
        moments = array(f"{name}: moments", data["moments"], (None, None)) if "moments" in data else None
        return cls(wrench, forces, moments)


def held_wrenches(forces: Forces, moments: Moments) -> list[HeldWrench]:
    """Return one record per wrench from the separate forces and moments of a solution."""
    beside = moments if len(moments) else [None] * len(forces)
    return [HeldWrench(w, f, m) for (w, f), m in zip(forces, beside, strict=True)]


def forces_and_moments(data: Sequence[ForcesData], name: str) -> tuple[Forces, Moments]:
    """Return the forces of a file, and the moments where contacts exert any.

    Raises
    ------
    InputError
        On arrays of other numbers of axes, or moments with some wrenches and not with others.
    """
    held = [HeldWrench.from_dict(entry, name) for entry in data]
    moments = tuple(entry.moments for entry in held if entry.moments is not None)
    if moments and len(moments) != len(held):
        raise InputError(f"{name}: forces", f"{len(moments)} entries with moments", "moments in all or in none")
    return tuple((entry.wrench, entry.forces) for entry in held), moments
