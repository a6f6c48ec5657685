"""Workspace: region that must contain contacts or the palm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from nlpgrasp.common.scalar_constraints import Label, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.regions import BoxRegion, ExpressionRegion, Region, region_from_dict
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Workspace(PlacementConstraint):
    """A region that must contain contacts or, with ``palm=True``, the palm's origin.

    Parameters
    ----------
    region : Region or callable
        A ``BoxRegion``, a ``HalfSpace``, or a function of a CasADi point that is positive inside.
    fingers : sequence of int, optional
        Indices of contacts; by default all.
    palm : bool
        Constrain the palm's origin instead.
    """

    kind: ClassVar[str] = "workspace"
    region: Region | Callable[[Expression], Expression]
    fingers: Sequence[int] | None = None
    palm: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "region", self._region)
        if not isinstance(self.palm, bool) or (self.palm and self.fingers is not None):
            raise InputError("Workspace.palm", self.palm, "True or False, and no fingers with True")
        if self.fingers is not None:
            object.__setattr__(self, "fingers", finger_numbers("Workspace.fingers", self.fingers))

    @property
    def _region(self) -> Region:
        """The region as a ``Region``, converted from a function if necessary."""
        if isinstance(self.region, Region):
            return self.region
        if not callable(self.region):
            raise InputError("Workspace.region", self.region, "a region or a function of a point")
        return ExpressionRegion(self.region, "Workspace.region")

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise for a region of another dimension than the body's, or for invalid finger indices."""
        dimension = self._region.dimension()
        if dimension not in (None, space):
            raise InputError("Workspace.region", f"{dimension} coordinates", f"{space} coordinates")
        check_fingers("Workspace.fingers", self.fingers, contacts)

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return one scalar constraint per point, or one per point and coordinate for a box."""
        if self.palm:
            if placement.palm is None:
                raise InputError("Workspace.palm", True, "a hand with a palm")
            return self._region_constraints(Label("workspace", link="palm"), placement.palm.position, placement.size)
        indices = range(len(placement.positions)) if self.fingers is None else self.fingers
        labels = [Label("workspace", fingers=(i,)) for i in indices]
        pairs = zip(indices, labels, strict=True)
        return [
            row for i, label in pairs for row in self._region_constraints(label, placement.positions[i], placement.size)
        ]

    def _region_constraints(self, label: Label, p: Expression, size: float) -> list[ScalarConstraint]:
        kind, fingers, link = label.kind, label.fingers, label.link
        region = self._region
        if isinstance(region, BoxRegion):
            limits = zip("xyz", np.asarray(region.lower), np.asarray(region.upper), strict=False)
            return [
                ScalarConstraint(kind, p[i], float(low), float(high), size, "m", fingers=fingers, link=link, part=axis)
                for i, (axis, low, high) in enumerate(limits)
            ]
        return [ScalarConstraint(kind, region.inside(p), 0.0, scale=size, unit=region.unit, fingers=fingers, link=link)]

    def to_dict(self) -> Json:
        """Return region, fingers and palm as JSON data."""
        fingers = None if self.fingers is None else list(self.fingers)
        return {"type": self.kind, "region": self._region.to_dict(), "fingers": fingers, "palm": self.palm}

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint from its data."""
        return cls(region_from_dict(data["region"]), data.get("fingers"), data.get("palm", False))


def finger_numbers(field: str, fingers: Sequence[int]) -> tuple[int, ...]:
    """Return finger indices, validated as nonnegative and distinct."""
    values = tuple(fingers) if isinstance(fingers, list | tuple | np.ndarray | range) else ()
    is_valid = all(isinstance(i, int | np.integer) and not isinstance(i, bool) for i in values)
    indices = tuple(int(i) for i in values) if is_valid else ()
    if not is_valid or not indices or min(indices) < 0 or len(set(indices)) != len(indices):
        raise InputError(field, fingers, "different numbers of fingers, from 0")
    return indices


def check_fingers(field: str, fingers: Sequence[int] | None, contacts: int) -> None:
    """Raise if a finger index is not below the number of contacts."""
    if fingers is not None and max(fingers) >= contacts:
        raise InputError(field, list(fingers), f"fingers 0 to {contacts - 1}")
