"""Numeric placement as a file states it: body, contacts and hand."""

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
    """Deviation of a contact from a face.

    Parameters
    ----------
    off : float
        Distance of the contact from the face, metres.
    turned : float or None
        Length of the difference between the stated inward normal and the face's; None where the fingertip may keep
        another normal than the face's.
    angle : float
        Angle of the stated normal to the mesh's, radians; an edge has all directions between its triangles' normals.
    """

    off: float
    turned: float | None
    angle: float = 0.0


class Surface(Protocol):
    """Interface of numeric bodies."""

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space), metres."""

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the deviation of a contact with this inward normal from a face.

        Parameters
        ----------
        face : str
            ``KeyError`` where the body has no such face.
        point, normal : (space,) arrays
        tip : str or None
            The kind of the posed fingertip at the contact, ``None`` for free contacts.
        """

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, space), (m,), metres, negative inside, as constraints state it."""

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a point (space,) of a face from its sharp edges, metres; infinite without any."""

    @property
    def rough(self) -> float:
        """Largest excess of the solver's obstacle distance over this one, metres; 0 where both are equal."""


@dataclass(frozen=True)
class Ball:
    """Collision sphere of a link, or contact ball of a fingertip.

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
    """Palm position and direction.

    Parameters
    ----------
    position : (3,) array
        Metres, body frame.
    approach : (3,) array or None
        Unit facing direction, body frame; None if not recorded.
    error : float
        Error bound of that direction, by the digits in the file.
    """

    position: FloatArray
    approach: FloatArray | None = None
    error: float = 0.0


class HandNumbers(Protocol):
    """Interface of numeric hands in the stated posture. Unknown results raise ``NotMadeError``."""

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip, metres; 0 for points and pads."""

    @property
    def linked(self) -> bool:
        """Whether it has links and joints with checks of their own."""

    @property
    def posed_tips(self) -> Sequence[str | None]:
        """Kind of each fingertip that is fixed to a posed link, ``None`` for free ones."""

    @property
    def error(self) -> float:
        """Error bound of its points, by the digits in the file, metres."""

    def palm(self) -> Palm | None:
        """Return the palm pose, ``None`` without one."""

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return the spheres of its links and fingertips; empty for a hand without links."""

    def rows(self, placement: StatedPlacement) -> Iterable[RowValue]:
        """Return the constraints of the hand on a placement, as files state them."""

    def apart(self) -> Iterable[RowValue]:
        """Return the self-collision constraints, as files state them."""

    def limits(self) -> Iterable[RowValue]:
        """Return the limits of the hand's variables, which files do not state as constraints."""


@dataclass(frozen=True)
class StatedPlacement:
    """Contacts and hand as stated in a file.

    Parameters
    ----------
    points, normals : (k, space) arrays
        Metres, body frame; unit, into the body.
    size : float
        The body's characteristic length, metres, limited by the contacts' spread: the reference of tolerances.
    hand : HandNumbers or None
    surface_of : callable
        Function of another body's JSON data to its ``Surface``.
    stated : mapping
        Stated values of all constraints, by name.
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
        """Collision spheres of the hand's links, without fingertips."""
        return [] if self.hand is None else [ball for ball in self.hand.balls(self) if not ball.is_tip]

    @property
    def error(self) -> float:
        """Error bound of the links' points, by the digits in the file, metres."""
        return 0.0 if self.hand is None else self.hand.error

    @property
    def palm(self) -> Palm:
        """The hand's palm pose."""
        found = None if self.hand is None else self.hand.palm()
        if found is None:
            raise NotMadeError("the hand has no palm")
        return found
