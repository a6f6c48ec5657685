"""Checks of a stated squeeze: equilibrium, friction cones and joint torques.

Forces are inserted into the equilibrium equations and the contacts' cones; torques come from virtual work with the
Jacobians of this package's own kinematics, from the URDF. That no other forces need less friction is not checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.optimize import linprog

from nlpgrasp.budgets.sets.l2 import L2Set
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.other_tools.pyramids import pyramid_wrenches
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotMadeError
from nlpgrasp.verify.claims.evidence import FORCE_TOLERANCE, put_back
from nlpgrasp.verify.hands.urdf import require_links
from nlpgrasp.verify.placement import HandNumbers

EDGES = 24  # edges of a friction pyramid
INSIDE = 0.98  # share of the friction that a refuting squeeze may use
INFEASIBLE = 2  # HiGHS status
SAME = 1e-6  # relative tolerance of recomputed Jacobians
LESS = 1e-3  # relative tolerance of the share of friction
LEAST = 1e-5  # smaller shares of friction count as none


def squeeze_checks(solution: GraspSolution, grasp: Grasp, hand: HandNumbers | None) -> list[Check]:
    """Check balance, cones, normal forces and friction of ``hand.squeeze``, then torques and positions."""
    posture = solution.hand or {}
    stated = posture.get("squeeze")
    if "no_squeeze" in posture:
        try:
            wrong = _none(grasp) if stated is None else "states a squeeze, and that there is none"
        except NotMadeError as reason:
            return [Check.not_made("squeeze", str(reason))]
        return [Check("squeeze", not wrong, wrong or "none: no forces that balance press at every contact")]
    if stated is None:
        return []
    wrong = "; ".join(_forces(stated, grasp))
    told = f"friction {stated['friction_needed']:.4g} needed, {stated['share']:.4g} of what there is"
    checks = [Check("squeeze", not wrong, wrong or told)]
    if "torques" not in stated:
        return checks
    try:
        wrong = "; ".join(_joints(stated, solution, grasp, hand))
    except NotMadeError as reason:
        return [*checks, Check.not_made("squeeze torques", str(reason))]
    return [
        *checks,
        Check("squeeze torques", not wrong, wrong or f"of {len(stated['torques'])} joints, by virtual work"),
    ]


def _none(grasp: Grasp) -> str:
    """Return the error in the claim that the contacts cannot press against each other; empty without one.

    Balanced forces on the edges of friction pyramids inside the cones, with a normal force at every contact, would
    refute it: a linear program, by HiGHS.
    """
    smoother = [model.with_friction(INSIDE) for model in grasp.contacts]
    try:
        edges = pyramid_wrenches(
            Grasp(grasp.points, grasp.normals, smoother, grasp.torque_origin, grasp.tangents), EDGES, grasp.mean_arm
        )
    except InputError as error:
        raise NotMadeError(str(error)) from None
    presses = np.zeros((len(grasp), sum(map(len, edges))))
    for i, end in enumerate(np.cumsum([len(each) for each in edges])):
        presses[i, end - len(edges[i]) : end] = -1.0
    balance, everywhere = np.concatenate(edges).T, -np.ones(len(grasp))
    found = linprog(np.ones(presses.shape[1]), presses, everywhere, balance, np.zeros(len(balance)), method="highs")
    return (
        ""
        if found.status == INFEASIBLE
        else "states that there is none, but forces that balance press at every contact"
    )


def _forces(stated: Json, grasp: Grasp) -> Iterator[str]:
    """Yield the errors in the forces."""
    k, space, d = len(grasp), grasp.space, grasp.dimension
    fingers, wrench = stated["fingers"], array("wrench", stated["wrench"], (d,))
    forces = array("force", [f["force"] for f in fingers], (k, space))
    turned = array("moment", [f.get("moment", [0.0] * (d - space)) for f in fingers], (k, d - space))
    balance, cone, _ = put_back(grasp, L2Set(grasp.contacts, space), wrench, forces, turned)
    if not (balance <= FORCE_TOLERANCE and cone <= FORCE_TOLERANCE):
        yield f"forces {balance:.1e} off balance and {cone:.1e} off their cones, relative to them"
    if not abs(stated["residual"] - balance) <= FORCE_TOLERANCE:
        yield f"residual {stated['residual']:.1e} stated, {balance:.1e} found"
    normal = np.sum(forces * grasp.normals, axis=1)
    friction = np.linalg.norm(forces - normal[:, None] * grasp.normals, axis=1) / normal
    for i, finger in enumerate(fingers):
        if not normal[i] >= stated["normal_force"] * (1.0 - SAME):
            yield f"finger {i} presses with {normal[i]:.4g} N, less than {stated['normal_force']:.4g} N"
        if not (_same(finger["normal"], normal[i]) and _same(finger["friction"], friction[i], 1.0)):
            yield f"finger {i} states another normal force or friction than its force has"
    if not _same(stated["friction_needed"], float(np.max(friction)), 1.0):
        yield f"friction {stated['friction_needed']:.4g} stated as needed, {np.max(friction):.4g} found"
    yield from _share(stated["share"], grasp, wrench, forces, turned)


def _share(share: float, grasp: Grasp, wrench: FloatArray, forces: FloatArray, turned: FloatArray) -> Iterator[str]:
    """Yield an error if forces need another share of friction than stated."""

    def off(part: float) -> float:
        models = [model.with_friction(part) for model in grasp.contacts]
        rougher = Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents)
        return put_back(rougher, L2Set(rougher.contacts, grasp.space), wrench, forces, turned)[1]

    enough = max(share, 0.0) + LEAST
    if not off(enough) <= FORCE_TOLERANCE:
        yield f"the forces need more than a share of {share:.4g} of the friction"
    less = (1.0 - LESS) * share - 2.0 * LEAST
    if less > 0.0 and not off(less) > 0.0:
        yield f"the forces need less than a share of {share:.4g} of the friction"


def _joints(stated: Json, solution: GraspSolution, grasp: Grasp, hand: HandNumbers | None) -> Iterator[str]:
    """Yield the errors in torques, Jacobians, limits and positions."""
    known = require_links(hand, "Jacobians")
    found, torques = known.loads(grasp.points), stated["torques"]
    if list(torques) != list(found):
        yield f"torques of {', '.join(torques)}, where {', '.join(found)} move the contacts"
        return
    forces = np.array([[*f["force"], *f.get("moment", [0.0] * 3)] for f in stated["fingers"]], dtype=float)
    size, close = float(np.max(np.linalg.norm(forces[:, :3], axis=1))), SAME + known.turn
    jacobians = array("jacobians", stated["jacobians"], (len(grasp), 6, len(found)))
    for j, (joint, J) in enumerate(found.items()):
        arm = max(1.0, float(np.max(np.abs(J))))
        if not np.max(np.abs(jacobians[:, :, j] - J)) <= close * arm:
            yield f"Jacobian of joint {joint} is not that of the hand in its posture"
        tau = float(np.sum(J * forces))
        if not abs(torques[joint] - tau) <= close * size * arm:
            yield f"joint {joint} needs {tau:.4g}, stated {torques[joint]:.4g}"
    limits = known.data.get("torque_limits") or {}
    shares = {joint: abs(torques[joint]) / limits[joint] for joint in found if joint in limits}
    worst, most = stated.get("worst_joint"), max(shares.values(), default=None)
    if (most is None) != (worst is None) or (most is not None and not _same(stated["worst_share"], most)):
        yield f"the worst joint's share of its torque limit is {most}, stated {stated.get('worst_share')}"
    elif worst is not None and not (worst in shares and _same(shares[worst], most)):
        yield f"joint {worst} is not the worst"
    yield from _positions(stated, solution)


def _positions(stated: Json, solution: GraspSolution) -> Iterator[str]:
    """Yield commands other than the grasp's positions plus torque over gain."""
    if "gain" not in stated:
        return
    gain, grasp, told = stated["gain"], (solution.hand or {})["joint_positions"], stated["positions"]
    if set(told) != set(stated["torques"]):
        yield "positions of other joints than torques"
        return
    for joint, tau in stated["torques"].items():
        command = grasp[joint] + tau / (gain[joint] if isinstance(gain, Mapping) else gain)
        if not _same(told[joint], command, 1.0):
            yield f"the command of joint {joint} is {command:.6g}, stated {told[joint]:.6g}"


def _same(stated: float, found: float | None, least: float = 0.0) -> bool:
    return found is not None and abs(stated - found) <= SAME * max(abs(found), least)
