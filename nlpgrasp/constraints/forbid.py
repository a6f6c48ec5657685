"""Forbidden faces and regions of the body."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Self

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import face_names
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.regions import ExpressionRegion, Region, region_from_dict
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Forbid(PlacementConstraint):
    """Forbidden faces or region, where no contact may lie.

    Parameters
    ----------
    faces_or_region : str, sequence of str, Region or callable
        Face names, a ``HalfSpace``, a ``BoxRegion``, or a function of a CasADi point that is positive inside the
        forbidden region.
    """

    kind: ClassVar[str] = "forbid"
    faces_or_region: str | Iterable[str] | Region | Callable[[Expression], Expression]

    def __post_init__(self) -> None:
        value = self.faces_or_region
        if isinstance(value, Region):
            return
        if callable(value):
            object.__setattr__(self, "faces_or_region", ExpressionRegion(value))
        else:
            object.__setattr__(self, "faces_or_region", face_names("Forbid.faces_or_region", value) or ())

    @property
    def region(self) -> Region | None:
        """The forbidden region, or None."""
        return self.faces_or_region if isinstance(self.faces_or_region, Region) else None

    def forbidden_faces(self) -> tuple[str, ...]:
        """Return the names of the forbidden faces."""
        return self.faces_or_region if isinstance(self.faces_or_region, tuple) else ()

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise if the region's dimension is not the body's."""
        if self.region is not None and self.region.dimension() not in (None, space):
            raise InputError("Forbid.region", f"{self.region.dimension()} coordinates", f"{space} coordinates")

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return one scalar constraint per contact for a forbidden region; an empty list for faces.

        The NLP omits forbidden faces.
        """
        if self.region is None:
            return []
        region = self.region
        return [
            ScalarConstraint(
                "forbidden region",
                region.inside(p),
                upper=0.0,
                scale=placement.size,
                unit=region.unit,
                fingers=(i,),
            )
            for i, p in enumerate(placement.positions)
        ]

    def to_dict(self) -> Json:
        """Return the faces or the region as JSON data."""
        if self.region is not None:
            return {"type": self.kind, "region": self.region.to_dict()}
        return {"type": self.kind, "faces": list(self.forbidden_faces())}

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint from its data."""
        return cls(region_from_dict(data["region"]) if "region" in data else data["faces"])
