"""Warnings about a squeeze: too weak for the task, or too little friction left."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.shown.numbers import percent
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.squeezed.squeeze import Squeeze

SPENT = 0.9  # share of the available friction above which a squeeze is warned of
FULL = 0.95  # share of a joint's effort that suggestions use
RESERVE = 1.5  # suggested normal force over the largest that the task needs


def slippery(squeeze: Squeeze | None) -> str:
    """Return a warning that a squeeze needs nearly all of the friction; empty where it does not, or none is known."""
    if squeeze is None or squeeze.share <= SPENT:
        return ""
    used = f"{percent(squeeze.share)} of the friction there is"
    return f"the squeeze alone needs {used}: little is left against pushes, however hard the fingers press"


def too_weak(squeeze: Squeeze | None, needed: ForcesNeeded | None, normal_force: float | None = None) -> str:
    """Return a warning that a squeeze is too weak for the task at full size; empty where it is not, or unknown.

    Parameters
    ----------
    squeeze : Squeeze or None
        Of the solution.
    needed : ForcesNeeded or None
        Finger forces of the task.
    normal_force : float, optional
        Requested normal force of each finger, newtons; the squeeze's own when left out.
    """
    if squeeze is None or needed is None:
        return ""
    pressed, most = normal_force or squeeze.normal_force, float(np.max(needed.normal))
    if most <= pressed:
        return ""
    wanted = float(f"{RESERVE * most:.2g}")
    told = f"the task needs up to {most:.3g} N at a finger, but this squeeze presses with {pressed:.3g} N at least"
    worst = None if squeeze.joints is None else squeeze.joints.worst
    if worst is not None and wanted * worst[1] > squeeze.normal_force:
        able = squeeze.normal_force / worst[1]
        if able <= pressed:
            return f"{told}, the most that joint {worst[0]} is strong enough for"
        return f"{told}: --normal-force {FULL * able:.2g} is what joint {worst[0]} is strong enough for"
    return f"{told}: --normal-force {wanted:g} presses for all of it"
