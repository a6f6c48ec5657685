"""Record of a finger's path: waypoints, joints and clearances, or the obstruction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray


@dataclass(frozen=True)
class FingerPath:
    """Waypoints of a moving finger while the palm and the other fingers stay.

    Parameters
    ----------
    feasible : bool
        Whether the hand completes the path, with no link deeper than ``tolerance`` in anything between waypoints.
    reason : str
        Reason for an infeasible path, with the place; empty if feasible.
    points : (m, space) array
        Point of the fingertip that touches, or will touch, metres, body frame: waypoints up to the end, or up to the
        last reachable one.
    along : (m,) array
        Arc length on the surface up to each waypoint, metres.
    phases : tuple of m str
        ``"sliding"``, ``"lifting off"``, ``"lifted"`` or ``"setting down"``; ``"moving"`` for hands without links.
    clearances : (m,) array
        Least distance of the moving parts of the hand to anything that they must not touch, metres, at each waypoint;
        inf without any.
    joint_names : tuple of n str
        The finger's own joints; empty for hands without joints.
    joints : (m, n) array
        Their positions, radians or metres; between waypoints on straight lines.
    stopped_at : float or None
        Arc length at which the hand is stopped, metres.
    tolerance : float
        Allowed penetration of links between waypoints, metres.
    """

    feasible: bool
    reason: str
    points: FloatArray
    along: FloatArray
    phases: tuple[str, ...]
    clearances: FloatArray
    joint_names: tuple[str, ...] = ()
    joints: FloatArray | None = None
    stopped_at: float | None = None
    tolerance: float = 0.0

    @property
    def clearance(self) -> float:
        """Least clearance of all waypoints, metres."""
        return float(np.min(self.clearances, initial=np.inf))

    def to_dict(self) -> Json:
        """Return the path as JSON data; an infinite clearance is None."""
        return {
            "feasible": self.feasible,
            "reason": self.reason,
            "points": self.points.tolist(),
            "along": self.along.tolist(),
            "phases": list(self.phases),
            "clearances": [float(c) if np.isfinite(c) else None for c in self.clearances],
            "joint_names": list(self.joint_names),
            "joints": None if self.joints is None else self.joints.tolist(),
            "stopped_at": self.stopped_at,
            "tolerance": self.tolerance,
        }

    def __str__(self) -> str:
        if not self.feasible:
            return f"the hand does not get there: {self.reason}"
        least = f", least clearance at them {1e3 * self.clearance:.1f} mm" if np.isfinite(self.clearance) else ""
        return f"within the hand's limits ({len(self.points)} waypoints{least})"
