"""What a file states of body, contacts and hand, as numbers: what its rows are recomputed from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.rows import RowValue


@dataclass(frozen=True)
class Fit:
    """How a contact fits a face.

    Parameters
    ----------
    off : float
        Distance of the contact from the face, metres.
    turned : float or None
        Length of the difference between the stated inward normal and the face's; None where the fingertip may keep
        another normal than the face's.
    angle : float
        Between the stated normal and the mesh's, radians; an edge has all directions between its triangles' normals.
    """

    off: float
    turned: float | None
    angle: float = 0.0


class Surface(Protocol):
    """A body as numbers."""

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space), metres."""

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return how a contact with this inward normal fits a face.

        Parameters
        ----------
        face : str
            ``KeyError`` where the body has no such face.
        point, normal : (space,) arrays
        tip : str or None
            The kind of the posed fingertip that touches there, ``None`` where contacts are free.
        """

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, space), (m,), metres, negative inside, as constraints state it."""

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a point (space,) of a face from its sharp edges, metres; infinite without any."""

    @property
    def rough(self) -> float:
        """How far above this distance the solver's own may be at an obstacle, metres; 0 where both are equal."""


@dataclass(frozen=True)
class Ball:
    """A sphere that stands for a part of a hand.

    Parameters
    ----------
    name : str
        ``"link/number"``, or ``"link, finger i"`` of a fingertip.
    centre : (3,) array
        Metres, body frame.
    radius : float
        Metres.
    least : float
        Least distance of the centre from the held body, metres.
    is_tip : bool
        Whether it is a fingertip.
    """

    name: str
    centre: FloatArray
    radius: float
    least: float
    is_tip: bool = False


@dataclass(frozen=True)
class Palm:
    """Where the palm is.

    Parameters
    ----------
    position : (3,) array
        Metres, body frame.
    approach : (3,) array or None
        Unit direction in which it faces, body frame; None where the file does not record it.
    error : float
        How far that direction may be off for want of digits in the file.
    """

    position: FloatArray
    approach: FloatArray | None = None
    error: float = 0.0


class HandNumbers(Protocol):
    """A hand as numbers, in the posture that a file states. What cannot be known raises ``NotMadeError``."""

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip, metres; 0 for points and pads."""

    @property
    def linked(self) -> bool:
        """Whether it has links and joints that are checked by themselves."""

    @property
    def posed_tips(self) -> Sequence[str | None]:
        """The kind of each fingertip that is fixed to a posed link, ``None`` for those that are free."""

    @property
    def error(self) -> float:
        """How far a point of it may be off for want of digits in the file, metres."""

    def palm(self) -> Palm | None:
        """Return where its palm is, ``None`` where it has none."""

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return the spheres that stand for its links and fingertips; none of a hand without links."""

    def rows(self, placement: StatedPlacement) -> Iterable[RowValue]:
        """Return the rows that the hand puts on a placement, as files state them."""

    def apart(self) -> Iterable[RowValue]:
        """Return the rows that keep the hand off itself, as files state them."""

    def limits(self) -> Iterable[RowValue]:
        """Return the limits of the hand's own variables, which files do not state as rows."""


@dataclass(frozen=True)
class StatedPlacement:
    """Contacts and hand as a file states them.

    Parameters
    ----------
    points, normals : (k, space) arrays
        Metres, body frame; unit, into the body.
    size : float
        The body's characteristic length, metres, as far as the contacts bear it out: what tolerances are relative to.
    hand : HandNumbers or None
    surface_of : callable
        JSON data of another body to its ``Surface``.
    stated : mapping
        Stated values of all rows, by name.
    """

    points: FloatArray
    normals: FloatArray
    size: float
    hand: HandNumbers | None
    surface_of: Callable[[Json], Surface]
    stated: Mapping[str, float]

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip, metres."""
        return [0.0] * len(self.points) if self.hand is None else self.hand.radii

    @property
    def tips(self) -> FloatArray:
        """Centres of the fingertips, (k, space): ``p - r n``."""
        return np.asarray(self.points - np.asarray(self.radii, dtype=float)[:, None] * self.normals)

    @property
    def links(self) -> Sequence[Ball]:
        """The spheres of the hand's links, fingertips apart."""
        return [] if self.hand is None else [ball for ball in self.hand.balls(self) if not ball.is_tip]

    @property
    def error(self) -> float:
        """How far a link may be off for want of digits in the file, metres."""
        return 0.0 if self.hand is None else self.hand.error

    @property
    def palm(self) -> Palm:
        """Where the hand's palm is."""
        found = None if self.hand is None else self.hand.palm()
        if found is None:
            raise NotMadeError("the hand has no palm")
        return found
