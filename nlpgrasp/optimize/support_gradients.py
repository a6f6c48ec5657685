"""Support functions and their gradients in a program's variables, by the envelope theorem.

``phi(y) = max <y, G(p) x>`` over the admissible forces x has no closed form for some contacts and budgets. Its gradient
is that of ``<y, G(p) x>`` with the maximiser x held fixed in the contact frames (Danskin 1966, doi:10.1137/0114053).
With the twist ``y = (v, w)`` of the body, contact i at ``r_i`` from the torque origin moves at ``u_i = v + w x r_i``.
Its force f and moment m turn with the contact's normal n:

    d<y, G x> / dr_i = f x w,    d<y, G x> / dn_i = t x n,    t = f x u_i + m x w.

A contact with a direction d of its own also turns about n, since its first tangent ``t_1`` is along d. That adds
``(n . t) c`` with ``c = -(n . d) t_2 / |d - (n . d) n|``. Joint-torque limits with constant Jacobians depend on the
frames, too: joints at the rates ``nu / tau``, from the limits' multipliers nu, move contact i at a velocity which is
taken off ``u_i`` and w. Where the Jacobians depend on the hand's posture, ``VirtualWork`` has the gradient.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import ForceBudget, JointTorqueLimits, SharedJointTorqueLimits
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.budgets.torque_sets import TorqueSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.force_problem import LeastForces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task


def support_gradients(
    compiled: CompiledProblem, candidate: GraspCandidate, z: FloatArray, cuts: FloatArray, task: Task | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return a candidate's support function along cuts (m, d), and its gradients in the program's variables.

    The supports are (m,) and the gradients (m, n), in the solver's units.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
    z : (n,) array
        Variables of the cutting-plane program at the candidate.
    cuts : (m, d) array
        Directions.
    task : Task, optional
        Of whose support ratio the cuts are minimisers: at a kink the gradient is that of the least ratio nearby.
    """
    grasp, budget = compiled.grasp(candidate), compiled.budget(candidate)
    work = cuts @ grasp.G
    wrenches, rates = WrenchSet.of(grasp, budget), list[FloatArray]()
    if isinstance(wrenches.force_set, TorqueSet):  # its prices are the same at all maximisers
        x, prices = wrenches.force_set.maximise_with_prices(work)
        rates = _joint_rates(budget, prices)
    else:
        x = wrenches.force_set.support(work)[1]
    if task is not None:
        x = _tight_forces(wrenches, cuts, task, x)
    forces, moments = _contact_wrenches(grasp, x)
    support = compiled.scaling.beta * np.sum(work * x, axis=1)
    if compiled.problem.budget.follows_hand:
        return support, compiled.virtual_work.slopes(z, grasp.normals, cuts, forces, moments, rates[0])
    joint_motions = _joint_motions(budget, rates, grasp.space)
    by_position, by_normal = _contact_gradients(grasp, cuts, forces, moments, joint_motions)
    gradients, program = np.zeros((len(cuts), len(z))), compiled.cutting_planes.functions.program
    for i in range(len(grasp)):
        position, normal = program.block("position", i), program.block("normal", i)
        gradients[:, position.range] = position.scale * by_position[:, i]
        gradients[:, normal.range] = normal.scale * by_normal[:, i]
    return support, compiled.scaling.beta * gradients


def _tight_forces(wrenches: WrenchSet, cuts: FloatArray, task: Task, x: FloatArray, exact: float = 1e-6) -> FloatArray:
    """Return maximisers (m, n) of the work along cuts (m, d) that exert the task's tight wrench, or those given.

    None do where a cut is no minimiser of the support ratio; the wrench then is outside the set by ``exact`` at least.
    """
    if isinstance(wrenches.force_set, L2Set):
        return x
    problem, _ = make_containment(wrenches, task)
    if problem is None or not len(cuts):
        return x
    reach, demands = task.support(cuts)
    demands = demands * (np.sum((cuts @ wrenches.G) * x, axis=1) / np.maximum(reach, 1e-300))[:, None]
    found, _ = LeastForces(problem.wrenches).solve(demands @ problem.matrix.T)
    amount = wrenches.force_set.gauge(found)
    is_tight = np.all(np.isfinite(found), axis=1) & (np.abs(amount - 1.0) < exact)
    return np.where(is_tight[:, None], found / np.where(is_tight, amount, 1.0)[:, None], x)


def _contact_wrenches(grasp: Grasp, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return forces and moments (m, k, 3) of the contacts in the body frame, for force components x (m, n)."""
    wrenches = grasp.contact_wrenches(x)
    return _in_space(wrenches[..., : grasp.space]), _moments_in_space(wrenches[..., grasp.space :])


def _contact_gradients(
    grasp: Grasp,
    cuts: FloatArray,
    forces: FloatArray,
    moments: FloatArray,
    joint_motions: tuple[FloatArray, FloatArray] | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the gradients of ``<y, G x>`` in contact points and normals, (m, k, space) each.

    Parameters
    ----------
    grasp : Grasp
    cuts : (m, d) array
        Directions y.
    forces, moments : (m, k, 3) array
        Of the maximisers, body frame.
    joint_motions : pair of (m, k, 3) arrays, optional
        Velocities and angular velocities of the contacts due to the joints.
    """
    space = grasp.space
    angular = _moments_in_space(cuts[:, None, space:])
    velocity = _in_space(cuts[:, None, :space]) + np.cross(angular, _in_space(grasp.points - grasp.torque_origin)[None])
    by_position = np.cross(forces, angular)
    if joint_motions is not None:
        velocity, angular = velocity - joint_motions[0], angular - joint_motions[1]
    turning = np.cross(forces, velocity) + np.cross(moments, angular)
    normals = _in_space(grasp.normals)
    by_normal = np.cross(turning, normals[None])
    for i, contact in enumerate(grasp.contacts):
        direction = getattr(contact, "direction", None)
        if direction is not None and space > 2:
            along = float(normals[i] @ direction)
            tangential = np.linalg.norm(np.asarray(direction) - along * normals[i])
            second = grasp.frames[i][:, 2]
            by_normal[:, i] -= np.outer(turning[:, i] @ normals[i], along / tangential * second)
    return by_position[..., :space], by_normal[..., :space]


def _joint_rates(budget: ForceBudget, prices: FloatArray) -> list[FloatArray]:
    """Return the joint rates ``nu / tau`` (m, joints) for each contact, from multipliers nu of torque limits tau."""
    if isinstance(budget, SharedJointTorqueLimits):
        return [prices[:, : len(budget.limits)] / budget.limits] * len(budget.jacobians)
    if isinstance(budget, JointTorqueLimits):
        ends = np.cumsum([len(limits) for limits in budget.limits])
        return [part / tau for part, tau in zip(np.split(prices, ends[:-1], axis=1), budget.limits, strict=True)]
    raise InputError("force_budget", budget.kind, "joint-torque limits")


def _joint_motions(budget: ForceBudget, rates: list[FloatArray], space: int) -> tuple[FloatArray, FloatArray] | None:
    """Return velocities and angular velocities (m, k, 3) of contacts due to joint rates.

    None for budgets without joint-torque limits.
    """
    if not isinstance(budget, JointTorqueLimits | SharedJointTorqueLimits):
        return None
    motions = [rate @ J.T for rate, J in zip(rates, budget.jacobians, strict=True)]
    velocities = [_in_space(motion[:, :space]) for motion in motions]
    return np.stack(velocities, axis=1), np.stack([_moments_in_space(motion[:, space:]) for motion in motions], axis=1)


def _in_space(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3): planar ones get a third component of zero."""
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 3 - vectors.shape[-1]))], axis=-1)


def _moments_in_space(moments: FloatArray) -> FloatArray:
    """Return moments (..., 3) from those of 0, 1 (about the third axis) or 3 components."""
    return np.concatenate([np.zeros((*moments.shape[:-1], 3 - moments.shape[-1])), moments], axis=-1)
