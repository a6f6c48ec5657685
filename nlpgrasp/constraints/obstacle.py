"""Clearance of fingertips and hand links from an obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.common.registry import SolidBody, solid_from_dict
from nlpgrasp.common.scalar_constraints import Clearance, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.spatial import Pose, quaternion_wxyz, rigid_transform
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number, replace_unchecked
from nlpgrasp.constraints.base import PlacementConstraint, is_unit
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Obstacle(PlacementConstraint):
    """An obstacle: a body from which fingertips and hand links keep a clearance.

    Parameters
    ----------
    body : Body
        Any body of the same dimension.
    clearance : float
        Least distance, metres, at least zero.
    position : (space,) array, optional
        Of the obstacle's frame in the grasped body's, metres; by default the same origin.
    quaternion : (4,) array, optional
        Its orientation, (w, x, y, z); by default that of the grasped body. Bodies in space only.
    name : str
        Shown in reports.
    pose : (4, 4) array or mapping, optional
        Of the obstacle's frame in the grasped body's, instead of position and quaternion: a matrix, (3, 3) in the
        plane and without rotation, or a mapping with ``position`` and ``quaternion_wxyz`` or ``quaternion_xyzw``.
    """

    kind: ClassVar[str] = "obstacle"
    body: SolidBody
    clearance: float = 0.0
    position: ArrayLike | None = None
    quaternion: ArrayLike | None = None
    name: str = "obstacle"
    pose: InitVar[Pose | None] = field(default=None, kw_only=True)

    def __post_init__(self, pose: Pose | None) -> None:
        if isinstance(self.body, type) or not isinstance(self.body, SolidBody):
            raise InputError("Obstacle.body", self.body, "a body such as ng.Box or ng.Mesh")
        object.__setattr__(self, "clearance", number("Obstacle.clearance", self.clearance, at_least=0.0))
        if not isinstance(self.name, str) or not self.name:
            raise InputError("Obstacle.name", self.name, "a non-empty name")
        if pose is not None:
            self._set_pose(pose)
        if self.position is not None:
            object.__setattr__(self, "position", _check_tuple("Obstacle.position", self.position, self.body.space))
        if self.quaternion is not None:
            if self.body.space == 2:
                raise InputError("Obstacle.quaternion", self.quaternion, "none for a planar body")
            quaternion = np.array(_check_tuple("Obstacle.quaternion", self.quaternion, 4))
            size = float(np.linalg.norm(quaternion))
            if size == 0.0:
                raise InputError("Obstacle.quaternion", self.quaternion, "a quaternion that is not zero")
            object.__setattr__(self, "quaternion", tuple((quaternion / size).tolist()))

    def _set_pose(self, pose: Pose) -> None:
        if self.position is not None or self.quaternion is not None:
            raise InputError("Obstacle.pose", "a pose beside position or quaternion", "one of them")
        rotation, translation = rigid_transform("Obstacle.pose", pose, self.body.space)
        if self.body.space == 3:
            object.__setattr__(self, "quaternion", quaternion_wxyz(rotation).tolist())
        elif not np.array_equal(rotation, np.eye(2)):
            raise InputError("Obstacle.pose", "a planar body that is turned", "a translation alone: turn its polygon")
        object.__setattr__(self, "position", translation.tolist())

    @property
    def rotation(self) -> FloatArray:
        """Rotation matrix (space, space) from the obstacle's frame to the grasped body's."""
        if self.quaternion is None:
            return np.eye(self.body.space)
        return np.asarray(Rotation.from_quat(np.asarray(self.quaternion), scalar_first=True).as_matrix())

    def check(self, space: int, size: float, contacts: int) -> None:
        """Raise if the obstacle and the grasped body differ in dimension."""
        if self.body.space != space:
            raise InputError("Obstacle.body", f"a body of {self.body.space} dimensions", f"one of {space}")

    def rows(self, placement: SymbolicCandidate) -> Sequence[ScalarConstraint | Clearance]:
        """Return one clearance constraint per fingertip and per probe of a link.

        A program has no probes: its links keep the clearance by their collision shapes.
        """
        tips = zip(placement.tips, placement.radii, strict=True)
        tip_clearances = [
            self._sphere_clearance(tip, radius, placement.size, fingers=(i,)) for i, (tip, radius) in enumerate(tips)
        ]
        return tip_clearances + [
            self._sphere_clearance(s.centre, s.radius, placement.size, link=s.link) for s in placement.links
        ]

    def _sphere_clearance(
        self, point: Expression, radius: float, size: float, fingers: tuple[int, ...] = (), link: str = ""
    ) -> Clearance:
        """Return the constraint that a sphere of the hand keeps the clearance from the obstacle."""
        distance, lower = self.body.distance_function, radius + self.clearance
        return Clearance(self.name, distance, self._local(point), lower, size, fingers=fingers, link=link)

    def _local(self, point: Expression) -> Expression:
        """Return a point in the obstacle's coordinates."""
        if self.position is not None:
            point = point - ca.DM(np.asarray(self.position))
        return point if self.quaternion is None else ca.mtimes(ca.DM(self.rotation.T), point)

    def to_dict(self) -> Json:
        """Return the body, its pose and the clearance as JSON data."""
        return {
            "type": self.kind,
            "name": self.name,
            "body": self.body.to_dict(),
            "clearance": self.clearance,
            "position": None if self.position is None else list(np.asarray(self.position, float)),
            "quaternion_wxyz": None if self.quaternion is None else list(np.asarray(self.quaternion, float)),
        }

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the constraint from its JSON data, without rescaling a unit quaternion."""
        body, quaternion = solid_from_dict(data["body"]), data.get("quaternion_wxyz")
        result = cls(body, data.get("clearance", 0.0), data.get("position"), quaternion, data.get("name", "obstacle"))
        return (
            replace_unchecked(result, quaternion=tuple(quaternion))
            if quaternion is not None and is_unit(quaternion)
            else result
        )


def _check_tuple(field: str, value: ArrayLike, size: int) -> tuple[float, ...]:
    """Return a validated array of numbers as a tuple."""
    return tuple(array(field, value, (size,)).tolist())
