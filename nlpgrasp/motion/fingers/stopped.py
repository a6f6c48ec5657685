"""Reason why a finger's motion stops, as text."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.fingers.finger_joints import FingerJoints
from nlpgrasp.motion.paths.strides import OVER, SLIDING, Foothold


def why_stopped(joints: FingerJoints, values: Values, hold: Foothold, allowed: FloatArray) -> str:
    """Return the obstruction of a finger's next waypoint, as text.

    Clearances are relaxed first, then joint limits; the relaxation that is needed is the reason. It is a local
    statement, for postures near the last one.

    Parameters
    ----------
    joints : FingerJoints
    values : dict
        The last reachable posture.
    hold : Foothold
        The next waypoint.
    allowed : (n,) array
        Lower limits of the clearances.
    """
    return f"{_what(joints, values, hold, allowed)}, {place(hold)}"


def place(hold: Foothold) -> str:
    """Return a finger's place on its path, as text."""
    where = f"{1e3 * hold.along:.1f} mm along the path"
    return where if hold.phase in (SLIDING, OVER) else f"{where}, {hold.phase}, {1e3 * hold.height:.1f} mm high"


def _what(joints: FingerJoints, values: Values, hold: Foothold, allowed: FloatArray) -> str:
    if not len(joints.own):
        return "no joint moves this finger alone"
    if joints.reach(values, hold, allowed).there:
        return "the posture would have to jump"
    within = joints.reach(values, hold, None)
    if within.there:
        return joints.around.say(int(np.argmin(joints.around.clearances(within.values) - allowed)))
    beyond = joints.reach(values, hold, None, limited=False)
    if beyond.there:
        return _limit(joints, values, beyond.values)
    return "out of the finger's reach"


def _limit(joints: FingerJoints, values: Values, beyond: Values) -> str:
    """Return the joint at its limit: of those that would exceed it, the nearest to it now."""
    lower, upper = joints.hand.tree.joint_limits[:, joints.own]
    now, then = values["joints"][joints.own], beyond["joints"][joints.own]
    over = np.maximum(lower - then, then - upper)
    left = np.where(then < lower, now - lower, upper - now)
    j = int(np.argmin(np.where(over > 0.0, left, np.inf)))
    side = "lower" if then[j] < lower[j] else "upper"
    return f"joint {joints.names[j]} at its {side} limit"
