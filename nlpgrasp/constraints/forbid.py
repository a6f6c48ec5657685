"""Parts of the body that must not be touched."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Self

from nlpgrasp.common.rows import Placement, Row
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import names
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.regions import ExpressionRegion, Region, region_from_dict
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Forbid(PlacementConstraint):
    """No contact on some faces, or in some region of the body.

    Parameters
    ----------
    faces_or_region : str, sequence of str, Region or callable
        Face names; or a ``HalfSpace``, a ``BoxRegion``; or a function of a CasADi point that is
        positive inside the forbidden region.
    """

    kind: ClassVar[str] = "forbid"
    faces_or_region: str | Iterable[str] | Region | Callable[[Expression], Expression]

    def __post_init__(self) -> None:
        what = self.faces_or_region
        if isinstance(what, Region):
            return
        if callable(what):
            object.__setattr__(self, "faces_or_region", ExpressionRegion(what))
        else:
            object.__setattr__(self, "faces_or_region", names("Forbid.faces_or_region", what) or ())

    @property
    def region(self) -> Region | None:
        """The region, when this forbids one."""
        return self.faces_or_region if isinstance(self.faces_or_region, Region) else None

    def forbidden_faces(self) -> tuple[str, ...]:
        """Return the face names, when this forbids faces."""
        return self.faces_or_region if isinstance(self.faces_or_region, tuple) else ()

    def check(self, space: int, size: float, contacts: int) -> None:
        """Refuse a region of another dimension than the body's."""
        if self.region is not None and self.region.dimension() not in (None, space):
            raise InputError("Forbid.region", f"{self.region.dimension()} coordinates", f"{space} coordinates")

    def rows(self, placement: Placement) -> list[Row]:
        """Return one row for each contact for a region; faces are left out of the program altogether."""
        if self.region is None:
            return []
        region = self.region
        return [
            Row(
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
        """Return the faces or the region."""
        if self.region is not None:
            return {"type": self.kind, "region": self.region.to_dict()}
        return {"type": self.kind, "faces": list(self.forbidden_faces())}

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint of a file: of faces, or of a region."""
        return cls(region_from_dict(data["region"]) if "region" in data else data["faces"])
