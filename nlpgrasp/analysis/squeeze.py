"""Squeeze of a grasp: balanced finger forces that need the least friction, and the hand's joint torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand, PosedHand
from nlpgrasp.motion.keyframes import add_squeeze_and_lift
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_friction import NoBalanceError, balanced_forces
from nlpgrasp.solution.solution import GraspSolution, require_solution
from nlpgrasp.solution.squeeze_record import Gain, JointSqueeze, Squeeze, servo_gain
from nlpgrasp.tasks.tools import WEIGHT

NORMAL_FORCE = 2.0  # newtons, the usual least normal force of each contact
MOST_EFFORT = 0.98  # share of the weakest joint's limit that the squeeze of a solution takes, at most
EASY_EFFORT = 0.6  # the same, to press harder than the usual force: the rest of the limit is left for pushes


def squeeze(
    solution: GraspSolution | Grasp,
    normal_force: float = NORMAL_FORCE,
    gravity: ArrayLike | None = None,
    gain: Gain | None = None,
    *,
    up: ArrayLike | None = None,
    hand: Hand | None = None,
) -> Squeeze:
    """Return balanced finger forces that need the least friction, and the joint torques that exert them.

    Of all forces f in the contacts' cones with ``G f = w`` and normal forces of at least ``normal_force``, whose sum
    is at most twice the least there is, those in the narrowest cones: friction and torsional friction of all contacts
    times one share s, as small as can be. Where all contacts have the same friction that is the least largest ratio of
    tangential to normal force, ``min max_i |f_t,i| / f_n,i``. Of these the forces of least L2 norm. The problem is
    quasi-convex and solved exactly, by a few small conic programs (docs/hands.md). Without the limit on the sum a
    weight would be held with ever less friction, by ever more force.

    Joint torques are ``tau = sum_i J_i^T (f_i, m_i)``: what the actuators have to apply for the fingers to exert these
    forces on the body, by virtual work, at rest and without the links' own weight.

    Parameters
    ----------
    solution : GraspSolution or Grasp
        With a grasp; one of a URDF hand gives torques and commands too, also when read from a file with
        ``hand.squeeze``.
    normal_force : float
        What each contact presses with at least, newtons.
    gravity : float or (d,) array, optional
        What is carried: a mass in kilograms, at the grasp's torque origin (the body's centroid unless the problem
        says otherwise), or the wrench that the fingers exert, about that origin: the opposite of the weight's.
        Nothing when left out.
    gain : float or mapping of str to float, optional
        Of the joints' position control, newton-metres a radian (newtons a metre of sliding joints), for
        ``Squeeze.positions``.
    up : (space,) array, optional
        Against gravity, body frame, for a mass; its last axis when left out.
    hand : URDFHand, optional
        Where the solution does not hold its Jacobians: one read from a file without ``hand.squeeze``.

    Returns
    -------
    Squeeze
        Forces, moments, the friction they need, and with a hand's joints torques, their limits and commands.

    Raises
    ------
    InputError
        Without a grasp; on numbers out of range; where no forces press at all contacts, with the contacts that cannot
        and the friction that would do.
    """
    grasp = solution if isinstance(solution, Grasp) else require_solution(solution).require_grasp()
    least_force = number("normal_force", normal_force, above=0.0)
    wrench = _exerted_wrench(grasp, gravity, up)
    balance = balanced_forces(grasp, wrench, least_force)
    result = Squeeze.of(grasp, balance.x, balance.share, wrench, least_force)
    joints = None if isinstance(solution, Grasp) else _joint_squeeze(solution, result.wrenches, gain, hand)
    if joints is None and gain is not None:
        raise InputError("gain", gain, "none without a hand whose joints are known; give hand= an ng.URDFHand")
    return replace(result, joints=joints)


def squeeze_for_task(solution: GraspSolution, hand: PosedHand | None = None) -> Squeeze:
    """Return the squeeze whose least normal force is the largest one that the task requires.

    It is at least the default normal force, and above that loads no joint beyond 60 % of its limit. It is reduced where
    ``max_force`` or a joint's limit would be exceeded. Balanced forces scale, and so do joint torques. The gain of the
    joints' position control follows from these forces (``servo_gain``).

    Parameters
    ----------
    solution : GraspSolution
        With a grasp.
    hand : PosedHand, optional
        Whose joints exert it; forces alone without one, as of parallel jaws.

    Raises
    ------
    InputError
        As ``squeeze``.
    """
    usual = squeeze(solution, hand=hand)
    force = NORMAL_FORCE if solution.needed is None else max(NORMAL_FORCE, float(np.max(solution.needed.normal)))
    effort = 0.0 if usual.joints is None or usual.joints.worst is None else usual.joints.worst[1]
    limit_share = 0.0 if solution.max_force is None else usual.largest / solution.max_force
    factor = min(force / NORMAL_FORCE, max(1.0, EASY_EFFORT / effort) if effort > 0.0 else np.inf)
    factor /= max(1.0, factor * effort / MOST_EFFORT, factor * limit_share)
    result = usual if factor == 1.0 else squeeze(solution, factor * NORMAL_FORCE, hand=hand)
    if result.joints is None:
        return result
    return replace(result, joints=replace(result.joints, gain=servo_gain(result.joints, result.normal)))


def add_squeeze(solution: GraspSolution, hand: Hand | None) -> GraspSolution:
    """Return a solution with the hand's squeeze added, or with the reason why there is none.

    A solution with a squeeze, or with a hand without joints, is returned unchanged; so is one with too weak joints.
    """
    if not isinstance(hand, PosedHand) or not hand.loaded_joints or solution.grasp is None or solution.squeeze:
        return solution
    try:
        result = squeeze_for_task(solution, hand)
    except NoBalanceError as error:
        reason = {"reason": error.reason, **({} if error.friction is None else {"friction": error.friction})}
        return replace(solution, hand={**(solution.hand or {}), "no_squeeze": reason})
    except InputError:  # ``squeeze`` itself raises it
        return solution
    posture = add_squeeze_and_lift(hand, {**(solution.hand or {}), "squeeze": result.to_dict()}, result.positions())
    return replace(solution, hand=posture)


def add_squeezes(solution: GraspSolution, hand: Hand | None) -> GraspSolution:
    """Return a solution with squeezes of its alternative grasps added, if the hand can squeeze."""
    others = [replace(grasp, hand=add_squeeze(solution.with_answer(grasp), hand).hand) for grasp in solution.others]
    return replace(solution, others=tuple(others))


def _exerted_wrench(grasp: Grasp, gravity: ArrayLike | None, up: ArrayLike | None) -> FloatArray:
    """Return the wrench that the fingers exert, (d,)."""
    wrench = np.zeros(grasp.dimension)
    if gravity is None:
        return wrench
    if np.ndim(gravity) > 0:
        return array("gravity", gravity, (grasp.dimension,))
    upwards = np.eye(grasp.space)[-1] if up is None else array("up", up, (grasp.space,))
    length = float(np.linalg.norm(upwards))
    if length == 0.0:
        raise InputError("up", upwards.tolist(), "a direction")
    wrench[: grasp.space] = number("gravity", gravity, at_least=0.0) * WEIGHT * upwards / length
    return wrench


def _joint_squeeze(
    solution: GraspSolution, wrenches: FloatArray, gain: Gain | None, hand: Hand | None
) -> JointSqueeze | None:
    """Return the joint torques that exert forces and moments (k, d).

    None without Jacobians of the contacts.
    """
    posture = solution.hand or {}
    if hand is not None:
        if not isinstance(hand, PosedHand) or not hand.loaded_joints:
            raise InputError("hand", type(hand).__name__, "a hand with joints, such as ng.URDFHand")
        grasp = solution.require_grasp()
        if hand.count != len(grasp):
            raise InputError("hand", f"{hand.count} fingertips", f"{len(grasp)}, one a contact")
        jacobians = hand.contact_jacobians(hand.values_of(posture), grasp.points)
        names, limits = hand.loaded_joints, hand.torque_limits
        sliding = tuple(name for name, slides in hand.sliding_joints.items() if slides)
    elif solution.squeeze is not None and solution.squeeze.joints is not None:
        joints = solution.squeeze.joints
        jacobians, names, limits, sliding = joints.jacobians, tuple(joints.torques), joints.limits, joints.sliding
    else:
        return None
    return JointSqueeze.of(names, wrenches, jacobians, limits, posture["joint_positions"], gain, sliding)
