"""Check that a joint-torque budget is the hand's own, in the stated posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotMadeError
from nlpgrasp.verify.hands.free import FreeHand
from nlpgrasp.verify.hands.urdf import URDFNumbers, require_links
from nlpgrasp.verify.placement import HandNumbers

SAME = 1e-6  # relative tolerance of recomputed Jacobians
KINDS = ("joint_torques", "shared_joint_torques")


def torque_checks(solution: GraspSolution, grasp: Grasp, hand: HandNumbers | None) -> list[Check]:
    """Compare Jacobians and limits of a joint-torque budget with the hand's.

    Files state a hand's torque limits as ``shared_joint_torques`` in the solution's posture. Without a hand, Jacobians
    are the problem's own.
    """
    budget = solution.problem["force_budget"]
    if not isinstance(budget, Mapping) or budget.get("type") not in KINDS:
        return []
    try:
        return _compared(budget, grasp, hand)
    except NotMadeError as reason:
        return [Check.not_made("joint torques", str(reason))]


def _compared(budget: Json, grasp: Grasp, hand: HandNumbers | None) -> list[Check]:
    if hand is None or isinstance(hand, FreeHand):
        raise NotMadeError("no hand moves the contacts: the Jacobians are the problem's own")
    known = require_links(hand, "Jacobians")
    if budget["type"] != "shared_joint_torques":
        return [Check("joint torques", False, "each contact has joints of its own, where the hand's are common to all")]
    found = known.loads(grasp.points)
    own = np.array([known.data["torque_limits"][joint] for joint in found], dtype=float)
    limits = array("limits", budget["limits"], (len(found),))
    number("force_limit", budget["force_limit"], above=0.0)
    wrong = _other_jacobians(budget["jacobians"], found, known.turn)
    if not np.array_equal(limits, own):
        joint = list(found)[int(np.argmax(limits != own))]
        wrong = f"another limit for joint {joint} than problem.hand.torque_limits states"
    agree = f"Jacobians of {len(grasp)} contacts and limits of {len(found)} joints"
    return [Check("joint torques", not wrong, wrong or agree), _efforts(known, list(found))]


def _other_jacobians(stated: object, found: Mapping[str, FloatArray], turn: float) -> str:
    """Return the difference of stated and recomputed Jacobians, (k, 6 or 3, m); empty where they agree."""
    own = np.stack(list(found.values()), axis=2)  # (k, 6, m)
    for i, (J, expected) in enumerate(zip(_listed(stated, len(own)), own, strict=True)):
        rows = array(f"jacobians[{i}]", J, (None, own.shape[2]))
        if len(rows) not in (3, 6):
            return f"Jacobian {i} has {len(rows)} rows"
        off = float(np.max(np.abs(rows - expected[: len(rows)])))
        if not off <= (SAME + turn) * max(1.0, float(np.max(np.abs(expected)))):
            return f"Jacobian {i} is {off:.2g} off that of the hand in its posture"
    return ""


def _listed(stated: object, count: int) -> Sequence[object]:
    if not isinstance(stated, Sequence) or len(stated) != count:
        raise ValueError(f"not {count} Jacobians")
    return stated


def _efforts(hand: URDFNumbers, joints: Sequence[str]) -> Check:
    """Return the check that the limits are the URDF's efforts; users may have stated others."""
    efforts = {link.joint: link.effort for link in hand.links}
    other = [joint for joint in joints if hand.data["torque_limits"][joint] != efforts[joint]]
    if other:
        return Check.not_made("torque limits", f"those of {', '.join(other)} are the problem's own, not the URDF's")
    return Check("torque limits", True, f"of {len(joints)} joints, the URDF's efforts")
