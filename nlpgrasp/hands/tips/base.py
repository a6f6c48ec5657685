"""Base class of fingertip geometries."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.common.given.angles import angles
from nlpgrasp.common.given.pose import Pose, pose_matrix
from nlpgrasp.common.rows import ON_FINGERTIP, Row
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.hands.tips.patches import DOT, FINE, dome

SLACK = 2e-4  # metres that a touching link's spheres stay behind its patch
TILT = np.sin(np.radians(20.0))  # sine of the largest tilt of a finger without collision of its link


@dataclass(frozen=True)
class Touch:
    """Symbolic link pose and contact of a fingertip.

    Parameters
    ----------
    link : str
        The link's name.
    finger : int
        Number of the contact.
    pose : casadi.SX
        (4, 4) transform from the link's frame to the body's.
    p, n : casadi.SX
        Contact point and inward normal, body frame.
    slide : casadi.SX or None
        The patch's own coordinate.
    size : float
        The body's characteristic length, for scaling.
    """

    link: str
    finger: int
    pose: Expression
    p: Expression
    n: Expression
    slide: Expression
    size: float

    def row(
        self, part: str, expression: Expression, lower: float = 0.0, upper: float = np.inf, *, length: bool = False
    ) -> Row:
        """Return a constraint of the tip, on a length in metres or a number; ``part`` names it."""
        scale, unit = (self.size, "m") if length else (1.0, "")
        return Row(
            ON_FINGERTIP, expression, lower, upper, scale, unit, fingers=(self.finger,), link=self.link, part=part
        )


class Tip(ABC):
    """A convex patch of a link's surface that touches the body.

    At the contact the patch's outward normal is the body's inward normal n, and the point of the patch with
    that normal is the contact point p.
    """

    kind: ClassVar[str]

    @property
    @abstractmethod
    def centre(self) -> FloatArray:
        """Point in the middle of the patch or behind it, (3,), metres, link frame: the initial position."""

    @property
    def standoff(self) -> float:
        """Radius of the patch's ball behind the contact, metres; 0 for patches that are not round."""
        return 0.0

    @property
    def normal(self) -> FloatArray | None:
        """Outward unit normal of a flat patch, (3,), link frame; None for a curved one."""
        return None

    @property
    def slides(self) -> bool:
        """Whether the patch has a sliding coordinate between 0 and 1."""
        return False

    @property
    def first_slide(self) -> float:
        """Initial sliding coordinate: that with the ball at ``centre``."""
        return 0.5

    def slide_at(self, point: FloatArray) -> float:
        """Return the sliding coordinate of a contact (3,), metres, link frame."""
        del point
        return self.first_slide

    def ball_centre(self, pose: Expression, slide: Expression) -> Expression | None:
        """Return the centre of the ball behind the contact, body frame, for the link's pose; None without a ball."""
        return None

    @abstractmethod
    def rows(self, touch: Touch) -> list[Row]:
        """Return the constraints that put the contact onto the patch."""

    @abstractmethod
    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (m, 3), link frame, outside the patch's solid, (m,), metres."""

    @abstractmethod
    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return the largest radii of link spheres about points (m, 3) that leave the patch free, (m,), metres."""

    @property
    def backbone(self) -> FloatArray:
        """Ball centres of radius ``standoff`` behind the patch, (m, 3), metres, link frame."""
        return self.centre[None]

    def surface(self, sides: int = FINE) -> Triangles:
        """Return the patch as outward triangles in the link's frame; by default a ball.

        Parameters
        ----------
        sides : int
            Of what is round.
        """
        ball = dome(np.array([0.0, 0.0, 1.0]), np.pi, sides)
        return Triangles(self.centre + (self.standoff or DOT) * ball.vertices, ball.faces)

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the patch as JSON data."""


def equal(touch: Touch, left: Expression, right: Expression) -> list[Row]:
    """Return constraints ``left = right`` for columns of 3."""
    return [touch.row(axis, left[i] - right[i], 0.0, 0.0, length=True) for i, axis in enumerate("xyz")]


def frame_of(field: str, offset: ArrayLike, rpy: ArrayLike) -> FloatArray:
    """Return the (4, 4) transform of an offset and roll, pitch, yaw, checked."""
    pose = np.eye(4)
    pose[:3, 3] = array(f"{field}.offset", offset, (3,))
    turns = angles(f"{field}.rpy", array(f"{field}.rpy", rpy, (3,)))
    pose[:3, :3] = Rotation.from_euler("xyz", turns).as_matrix()
    return pose


def offset_and_rpy(
    field: str, offset: ArrayLike, rpy: ArrayLike, pose: Pose | None
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the given offset and roll, pitch, yaw, or those of a pose given instead."""
    if pose is not None:
        if np.any(np.asarray(offset, dtype=object) != 0.0) or np.any(np.asarray(rpy, dtype=object) != 0.0):
            raise InputError(f"{field}.pose", "a pose beside offset or rpy", "one of them")
        frame = pose_matrix(f"{field}.pose", pose)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # roll and yaw are not unique at a pitch of a right angle
            offset, rpy = frame[:3, 3], Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
    frame_of(field, offset, rpy)
    return tuple(np.asarray(offset, float).tolist()), tuple(np.asarray(rpy, float).tolist())
