"""Where contacts are while a search climbs: spots on the body's faces, and what those of many grasps do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.bound.weakest import Design
from nlpgrasp.best.cells.allowed import Allowed
from nlpgrasp.best.cells.base import Surface
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel


class Reach(Protocol):
    """Where contacts that are alike may be, and what they do there."""

    @property
    def slots(self) -> tuple[int, ...]:
        """The contacts."""

    @property
    def surfaces(self) -> Sequence[Surface]:
        """The faces they may use; one may be named more than once."""

    @property
    def allowed(self) -> Allowed:
        """Where on these they may be."""

    @property
    def supports(self) -> Supports:
        """What they do along twists."""


@dataclass(frozen=True)
class Spot:
    """Where one contact is.

    Parameters
    ----------
    pieces : Reach
        Where it may be.
    surface : Surface
        The face it is on.
    point, normal : (space,) array
        Metres; unit, into the body.
    """

    pieces: Reach
    surface: Surface
    point: FloatArray
    normal: FloatArray

    def moved(self, step: FloatArray) -> Spot:
        """Return the spot a step (space - 1,) along the face."""
        points, normals = self.surface.moved(self.point, step[None])
        return Spot(self.pieces, self.surface, points[0], normals[0])

    @property
    def allowed(self) -> bool:
        """Whether constraints permit it."""
        return self.pieces.allowed.permits(self.point[None], self.normal[None], 1e-9)


Spots = Sequence[Spot]


def by_model(spots: Spots) -> dict[ContactModel, list[int]]:
    """Return which spots have contacts of the same model."""
    found: dict[ContactModel, list[int]] = {}
    for i, spot in enumerate(spots):
        found.setdefault(spot.pieces.supports.contact, []).append(i)
    return found


def designs(grasps: Sequence[Spots]) -> list[Design]:
    """Return the contacts of grasps (b), alike from one to the next, in their places; those of one model together."""
    result = []
    for model, own in by_model(grasps[0]).items():
        supports = grasps[0][own[0]].pieces.supports
        points, normals = (
            np.stack([getattr(spots[i], n) for spots in grasps for i in own]) for n in ("point", "normal")
        )
        maps = supports.maps_at(points, normals)
        maps = maps.reshape(len(grasps), len(own), *maps.shape[1:])
        result.append(Design(model, supports.measure, maps, np.ones(maps.shape[:2])))
    return result
