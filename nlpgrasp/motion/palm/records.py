"""Record of a palm path to a grasp: waypoints, joints and clearances, or the reason for having none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.phases.approach import BlockedDirection

APPROACHING, CLOSING = "approaching", "closing"


@dataclass(frozen=True)
class PalmPath:
    """Waypoints of a hand from a distance to its grasp.

    Parameters
    ----------
    reason : str
        Why there is no path; empty where there is one.
    direction : (3,) array or None
        Unit direction of the palm's motion, body frame; None where no direction is free.
    distance : float
        How far it moves straight, metres.
    openings : (k,) array
        Distance of each fingertip on the approach from its position in the grasp, palm frame, metres; empty without a
        path.
    phases : tuple of m str
        ``"approaching"`` or ``"closing"``.
    poses : (m, 4, 4) array
        The palm's frame in the body's at each waypoint, from afar to the grasp.
    joint_names : tuple of n str
        All moving joints, mimic joints included.
    joints : (m, n) array
        Their positions, radians or metres. Between waypoints palm and joints move on straight lines.
    clearances : (m,) array
        Least distance of the hand to anything it must not touch, at each waypoint, metres; while the fingers close,
        fingertips and body are not counted.
    blocked : tuple of BlockedDirection
        The blocked directions that were tried.
    tolerance : float
        Allowed penetration of links between waypoints, metres.
    touching : str
        Obstructions in the grasp itself, as text: links that penetrate something, contacts off their links; empty
        without any.
    """

    reason: str
    direction: FloatArray | None
    distance: float
    openings: FloatArray
    phases: tuple[str, ...]
    poses: FloatArray
    joint_names: tuple[str, ...]
    joints: FloatArray
    clearances: FloatArray
    blocked: tuple[BlockedDirection, ...]
    tolerance: float
    touching: str = ""

    @property
    def success(self) -> bool:
        """Whether there is a path."""
        return not self.reason

    @property
    def clearance(self) -> float:
        """Least clearance of all waypoints, metres; inf without any."""
        return float(np.min(self.clearances, initial=np.inf))

    def to_dict(self) -> Json:
        """Return the path as JSON data; an infinite clearance is None."""
        return {
            "reason": self.reason,
            "direction": None if self.direction is None else self.direction.tolist(),
            "distance": self.distance,
            "openings": self.openings.tolist(),
            "phases": list(self.phases),
            "poses": self.poses.tolist(),
            "joint_names": list(self.joint_names),
            "joints": self.joints.tolist(),
            "clearances": [float(c) if np.isfinite(c) else None for c in self.clearances],
            "blocked": [b.to_dict() for b in self.blocked],
            "tolerance": self.tolerance,
            "touching": self.touching,
        }

    def __str__(self) -> str:
        first = f"{self.touching}\n" if self.touching else ""
        if not self.success or self.direction is None:
            return f"{first}no way of the palm: {self.reason}"
        along = np.array2string(self.direction, precision=3, suppress_small=True)
        way = f"{first}{1e3 * self.distance:.0f} mm along {along}, then closing"
        return f"{way}: {len(self.phases)} waypoints, least clearance at them {1e3 * self.clearance:.1f} mm"
