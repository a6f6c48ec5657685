"""Numeric models of hands without links: free fingertips, parallel jaws, unknown hands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NoReturn

import numpy as np

from nlpgrasp.common.scalar_constraints import FINGERTIP_CLEARANCE, TIPS_APART
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import ConstraintValue, NumericBody, Palm, StatedPlacement, require_body

TIP_CLEARANCE = 0.99  # least distance of a fingertip's centre from the body, in its radii
REENTRANT_ANGLE = 1e-9  # radians: least right turn of a reentrant corner
SMOOTH_LENGTH = 1e-12  # squared sizes of the body: added to a squared length by the solver, whose root is then smooth
NOT_CONVEX = ("torus", "mesh")  # and polygons with a reentrant corner


@dataclass(frozen=True)
class FreeHand:
    """Hand without links, whose fingertips are at its contacts.

    Parameters
    ----------
    data : mapping
        ``problem.hand``.
    posture : mapping
        ``hand``: the variables by name.
    radii : tuple of float
        Of the fingertips, metres.
    """

    data: Json
    posture: Json
    radii: Sequence[float]
    has_links: bool = False

    @property
    def fixed_tip_kinds(self) -> Sequence[None]:
        """None for each fingertip, as no fingertip is fixed to a link."""
        return [None] * len(self.radii)

    def palm(self) -> Palm | None:
        """Return None, as the hand has no palm pose."""
        return None

    def limits(self) -> Sequence[ConstraintValue]:
        """Return an empty list, as the hand's variables have no limits."""
        return []


class NumericFingertips(FreeHand):
    """Numeric model of the hand ``Fingertips``."""

    def rows(self, placement: StatedPlacement) -> Iterator[ConstraintValue]:
        """Yield the constraints on the fingertips' distances from the palm point and from each other."""
        tips, scale = placement.tips, placement.size**2
        if self.data["reach"] is not None:
            palm, most = self._palm_point(tips), number("reach", self.data["reach"]) ** 2
            for i, tip in enumerate(tips):
                yield ConstraintValue(f"reach, finger {i}", float(np.sum((tip - palm) ** 2)), upper=most, scale=scale)
        low, high = (0.0, np.inf) if self.data["spread"] is None else map(float, self.data["spread"])
        low = max(low, 2.0 * number("radius", self.data["radius"]))
        if low > 0.0 or np.isfinite(high):
            for i, j in combinations(range(len(tips)), 2):
                squared = float(np.sum((tips[i] - tips[j]) ** 2))
                yield ConstraintValue(f"{TIPS_APART}, fingers {i} and {j}", squared, low**2, high**2, scale)

    def _palm_point(self, tips: FloatArray) -> FloatArray:
        """Return the palm point in the file, (space,), metres."""
        return array("hand.palm", self.posture["palm"], (tips.shape[1],))


class NumericJaws(FreeHand):
    """Numeric model of the hand ``ParallelJaw``."""

    def rows(self, placement: StatedPlacement) -> Iterator[ConstraintValue]:
        """Yield the constraints on the opening, on the angle between the normals, and on theirs to the closing line."""
        (p, q), (m, n) = placement.points, placement.normals
        opening_vector = q - p
        squared, size = float(opening_vector @ opening_vector), placement.size
        closed, opening, tilt = (number(key, self.data[key]) for key in ("closed", "opening", "tilt"))
        smooth_length = np.sqrt(squared + SMOOTH_LENGTH * size**2)
        least_projection = np.cos(tilt) * smooth_length
        projections = float(m @ opening_vector - least_projection), float(-n @ opening_vector - least_projection)
        yield ConstraintValue("opening of the jaws", squared, lower=closed**2, upper=opening**2, scale=size**2)
        yield ConstraintValue("opposed jaws", float(m @ n), upper=-float(np.cos(2.0 * tilt)))
        yield ConstraintValue("facing, jaw 0", projections[0], lower=0.0, scale=size)
        yield ConstraintValue("facing, jaw 1", projections[1], lower=0.0, scale=size)


def fingertips(data: Json, posture: Json, stated: Mapping[str, float], sources: SourceFolders) -> NumericFingertips:
    """Return the numeric model of free fingertips of equal radius."""
    count = integer("count", data["count"], at_least=1)
    return NumericFingertips(data, posture, (number("radius", data["radius"], at_least=0.0),) * count)


def parallel_jaw(data: Json, posture: Json, stated: Mapping[str, float], sources: SourceFolders) -> NumericJaws:
    """Return the numeric model of parallel jaws with two flat pads."""
    return NumericJaws(data, posture, (0.0, 0.0))


@dataclass(frozen=True)
class UnknownHand:
    """Hand that cannot be recomputed: its methods raise ``NotCheckedError``.

    Parameters
    ----------
    reason : str
    """

    reason: str
    has_links: bool = False

    @property
    def radii(self) -> Sequence[float]:
        """Raise ``NotCheckedError``."""
        self._refuse()

    @property
    def fixed_tip_kinds(self) -> Sequence[str | None]:
        """Raise ``NotCheckedError``."""
        self._refuse()

    def palm(self) -> Palm | None:
        """Raise ``NotCheckedError``."""
        self._refuse()

    def rows(self, placement: StatedPlacement) -> Iterator[ConstraintValue]:
        """Raise ``NotCheckedError``."""
        self._refuse()

    def limits(self) -> Iterator[ConstraintValue]:
        """Raise ``NotCheckedError``."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        """Raise ``NotCheckedError`` with the reason."""
        raise NotCheckedError(self.reason)


def fingertip_clearances(
    body: Json, surface: NumericBody | None, placement: StatedPlacement
) -> Iterator[ConstraintValue]:
    """Yield the constraints on each round fingertip's distance from a non-convex body."""
    if not (body["type"] in NOT_CONVEX or (body["type"] == "polygon" and _has_reentrant_corner(body))):
        return
    round_tips = [i for i, radius in enumerate(placement.radii) if radius > 0.0]
    if not round_tips:
        return
    body_surface = require_body(surface)
    for i in round_tips:
        value = float(body_surface.distance(placement.tips[i][None])[0])
        yield ConstraintValue(
            f"{FINGERTIP_CLEARANCE}, finger {i}", value, TIP_CLEARANCE * placement.radii[i], scale=placement.size
        )


def _has_reentrant_corner(body: Json) -> bool:
    """Return whether a polygon has a reentrant corner."""
    v = array("vertices", body["vertices"], (None, 2))
    along = np.roll(v, -1, axis=0) - v
    angles = np.arctan2(along[:, 1], along[:, 0])
    turns = (np.roll(angles, -1) - angles + np.pi) % (2.0 * np.pi) - np.pi
    return bool(np.any(turns < -REENTRANT_ANGLE))
