"""What a squeeze of a grasp takes of the hand's efforts."""

from __future__ import annotations

import numpy as np

from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.quality.forces.least_friction import balanced_forces
from nlpgrasp.solution.squeezed.joints import JointSqueeze
from nlpgrasp.solution.squeezed.squeeze import Squeeze
from nlpgrasp.solve.squeeze import NORMAL_FORCE
from nlpgrasp.solve.surface.on_body import OnBody


def worst_share(hand: PosedHand, found: OnBody) -> float:
    """Return the largest share of a joint's torque limit that the usual squeeze takes, 0 without limits.

    Infinite where no forces press at all contacts.

    Parameters
    ----------
    hand : PosedHand
    found : OnBody
    """
    grasp, values, rest = found.grasp, found.placed.hand, np.zeros(found.grasp.dimension)
    names, limits = hand.loaded_joints, hand.torque_limits
    if not any(name in limits for name in names):
        return 0.0
    try:
        forces = balanced_forces(grasp, rest, NORMAL_FORCE)
    except InputError:
        return np.inf
    wrenches = Squeeze.of(grasp, forces.x, forces.share, rest, NORMAL_FORCE).wrenches
    jacobians, positions = hand.contact_jacobians(values, grasp.points), dict.fromkeys(names, 0.0)
    worst = JointSqueeze.of(names, wrenches, jacobians, limits, positions, None).worst
    return 0.0 if worst is None else worst[1]
