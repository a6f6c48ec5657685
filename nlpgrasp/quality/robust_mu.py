"""Least quality over all displacements of the contacts, turns of their frames and losses of friction.

A displaced contact is at ``p + d`` with d along its stated face, and its frame is turned by a rotation Q of an angle of
at most a. Forces are chosen once, from narrower cones, and stay admissible in every displaced grasp:

- *With friction* f, forces stay as they are in the body frame. With the sizes ``(|f_t| / f, |m| / f_m) <= r f_n`` about
  the stated normal and

      r = (cos a - sin a / f) / (1 + f sin a),

  a force is within the contact's own cone about every normal at an angle of at most a (|f_t| grows by at most
  f_n sin a, f_n falls by at most |f_t| sin a). Those at the corners of a pad turn with it, from R c to Q R c. Moments
  turn with the frame, and are exerted s-fold, ``s = cos a - r f sin a``, as the normal force falls by no more.
- *Other contacts* exert the same components in the turned frame, which are admissible as they were.

So a displaced grasp exerts another wrench with the same forces x, linear in x. Along a plane (a_f, a_m) it is less by

    -<a_m, d x F> - sum_j <(Q - I) r_j, b_j>   <=   offset |t| + sin a |sum_j r_j x b_j| + (1 - cos a) sum_j |r_j| |b_j|

with t the part of ``F x a_m`` along the face and the vectors r_j that turn: arms R c with ``b = u_c x a_m`` for the force
u_c at a corner, moments with ``b = a_m``, and forces about o with ``b = a_f + a_m x (p - o)`` (Rodrigues' formula
``Q - I = sin k^ + (1 - cos) (k k^T - I)``; in the plane all of this is embedded in space).

In the inner polytope of these forces (``quality.sandwich``) the half-space of a cell keeps its height less the largest
of these losses at its vertices. While the heights are positive no cell passes through the centre on the straight way
from its stated vertices to displaced ones, so that the displaced cells surround it as the stated ones do
(docs/proof_format.md): the scaled task that fits all half-spaces is exerted by every displaced grasp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets import force_budget as find_budget
from nlpgrasp.common.spatial import cross, in_space
from nlpgrasp.common.validation import FloatArray, IntArray, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.contacts.pad import PadContact
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu
from nlpgrasp.quality.provable_ends import LOSS, ForceCones, provable_lower
from nlpgrasp.quality.sandwich import tighten
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task


def robust_mu(
    grasp: Grasp,
    task: Task,
    offset: float = 0.001,
    angle: float = 0.09,
    friction_loss: float = 0.1,
    *,
    force_budget: str | ForceBudget = "l2",
    rtol: float = 0.03,
) -> Bounds:
    """Return bounds on the least mu over all displaced grasps.

    Parameters
    ----------
    grasp : Grasp
        In its stated place.
    task : Task
        About the grasp's torque origin.
    offset : float
        Metres: largest displacement of each contact along its face's tangent plane.
    angle : float
        Radians: largest angle of the rotation of each contact's frame. Normals tilt by at most it; pads may also turn
        on their faces by it.
    friction_loss : float
        Largest share of every friction coefficient that is lost, from 0 to below 1.
    force_budget : str or ForceBudget
        As for ``ng.mu``, not one that depends on the hand's posture.
    rtol : float
        Relative width of the certificates behind both ends.

    Returns
    -------
    Bounds
        ``lower`` holds for every displaced grasp; ``upper`` is certified of the worst one that was found.

    Raises
    ------
    InputError
        On a negative offset or angle, or a force budget that depends on contact frames.
    """
    require_grasp(grasp)
    task = task_for(task, grasp)
    offset = number("offset", offset, at_least=0.0)
    angle = number("angle", angle, at_least=0.0)
    if angle > 0.5:
        raise InputError("angle", angle, "radians, at most 0.5")
    loss = number("friction_loss", friction_loss, at_least=0.0)
    if loss >= 1.0:
        raise InputError("friction_loss", loss, "a share below 1")
    budget = find_budget(force_budget)
    if budget.depends_on_frames:
        raise InputError("force_budget", budget.kind, "one that does not depend on contact frames")
    weaker = grasp.with_friction(1.0 - loss)
    upper = _worst_found(weaker, task, offset, angle, budget, rtol)
    lower = min(_lower_end(weaker, task, offset, angle, budget, rtol), upper)
    return Bounds(lower, upper, kind="robust_mu")


def _lower_end(grasp: Grasp, task: Task, offset: float, angle: float, budget: ForceBudget, rtol: float) -> float:
    """Return a lower bound on mu for every displaced grasp."""
    space, frames = grasp.space, grasp.frames
    off_orthonormal = float(np.max(np.abs(frames.transpose(0, 2, 1) @ frames - np.eye(space))))
    guard = 16.0 * (off_orthonormal + LOSS)  # radians, which also cover rounding of cones
    narrower = [_narrow(contact, angle + guard, space) for contact in grasp.contacts]
    models = [contact for contact, _, _ in narrower if contact is not None]
    if len(models) < len(narrower):
        return 0.0
    inner = _with_frames(grasp, grasp.points, frames, models)
    wrenches = WrenchSet.of(inner, budget)
    problem, _ = make_containment(wrenches, task)
    if problem is None or problem.rank < grasp.dimension:
        return 0.0
    state = tighten(problem, rtol)
    if state.hull is None or state.upper == 0.0:
        return 0.0
    forces, cells = state.hull.vertices()
    domain = ForceCones.of(wrenches)
    variables = domain.into(domain.variables(forces))
    variables *= _moment_shares(models, [share for _, share, _ in narrower], space)
    variables /= max(growth for _, _, growth in narrower) * (1.0 + guard)
    planes = state.hull.cell_planes() @ problem.matrix
    losses = _losses(inner, variables, planes, cells, offset, angle + guard)
    return provable_lower(wrenches, variables @ domain.lift.T, cells, planes, task, losses)


def _moment_shares(contacts: Sequence[ContactModel], shares: Sequence[float], space: int) -> FloatArray:
    """Return a factor for each variable: a contact's share of variables that are moments, 1 of those that are forces."""
    factors = []
    for contact, share in zip(contacts, shares, strict=True):
        is_moment = np.array(contact.axes(space)) >= space
        at_corners = np.ones(3 * len(_corners(contact, space)))
        factors.append(at_corners if len(at_corners) else np.where(is_moment, share, 1.0))
    return np.concatenate(factors)


def _narrow(contact: ContactModel, angle: float, space: int) -> tuple[ContactModel | None, float, float]:
    """Return a contact with narrower cones, the share s of its moments, and by how much budgets count its forces more.

    Another normal makes normal forces larger, and turned arms of corners the moments about the contact. None instead
    of a contact whose friction no force keeps under every normal.
    """
    if not _keeps_forces(contact):
        return contact, 1.0, 1.0
    f, cos, sin = contact.coefficients["friction"], float(np.cos(angle)), float(np.sin(angle))
    share = (cos - sin / f) / (1.0 + f * sin)
    if share <= 0.0:
        return None, 1.0, 1.0
    arm = max((float(np.hypot(*corner)) for corner in _corners(contact, space)), default=0.0)
    turned = 1.0 + 2.0 * np.sin(0.5 * angle) * arm * np.hypot(1.0, share * f)
    return contact.with_friction(share), cos - share * f * sin, max(cos + share * f * sin, float(turned))


def _keeps_forces(contact: ContactModel) -> bool:
    """Return whether a contact exerts the same forces in the body frame, whichever way its frame is turned."""
    return isinstance(contact, RangeContact) and "friction" in contact.coefficients


def _corners(contact: ContactModel, space: int) -> tuple[tuple[float, float], ...]:
    """Return the positions along both tangents of the corners whose forces are a pad's variables; none of others."""
    points = contact.points(contact.components(space)) if isinstance(contact, PadContact) else None
    return () if points is None else points.arms


def _losses(
    grasp: Grasp, variables: FloatArray, planes: FloatArray, cells: IntArray, offset: float, angle: float
) -> FloatArray:
    """Return by how much displacements lower each vertex of each cell along the cell's plane, (f, d)."""
    space, start, total = grasp.space, 0, np.zeros(cells.shape)
    a_force, a_moment = in_space(planes[:, :space])[:, None], planes[:, space:]
    a_moment = np.pad(a_moment, ((0, 0), (3 - a_moment.shape[1], 0)))[:, None]  # in the plane about the third axis
    points, origin = in_space(grasp.points), in_space(grasp.torque_origin[None])[0]
    moment_size = np.linalg.norm(a_moment, axis=-1)
    for contact, p, axes in zip(grasp.contacts, points, grasp.frames, strict=True):
        frame = np.eye(3)
        frame[:space, :space] = axes
        count = contact.generators(space).shape[1]
        u = grasp.force_unit * variables[:, start : start + count]
        start += count
        # forces and moments of the vertices, (v, 3) each, and what turns with the frame, and along which gradients
        turning: list[tuple[FloatArray, FloatArray, FloatArray]] = []  # r_j, b_j, size of b_j
        corners = _corners(contact, space)
        if corners:
            parts = u.reshape(len(u), len(corners), 3) @ frame.T
            force, size = np.sum(parts, axis=1), np.sum(np.linalg.norm(parts, axis=2), axis=1)[cells]
            for (a, b), part in zip(corners, parts.transpose(1, 0, 2), strict=True):
                across = cross(part[cells], a_moment)
                turning.append(
                    (a * frame[:, 1] + b * frame[:, 2], across, np.linalg.norm(part, axis=1)[cells] * moment_size)
                )
        else:
            local = np.zeros((len(u), 6))
            local[:, [(0, 1, 5)[axis] if space == 2 else axis for axis in contact.axes(space)]] = u
            force, moment = local[:, :3] @ frame.T, local[:, 3:] @ frame.T
            size = np.linalg.norm(force, axis=1)[cells]
            turning.append((moment[cells], a_moment, moment_size))
            if not _keeps_forces(contact):
                arm = a_force + cross(a_moment, p - origin)
                arm_size = np.linalg.norm(a_force, axis=-1) + moment_size * (np.linalg.norm(p) + np.linalg.norm(origin))
                turning.append((force[cells], arm, arm_size))
                total += offset * 2.0 * np.sin(0.5 * angle) * size * moment_size
        slope = cross(force[cells], a_moment)  # of the moment with the displacement
        total += offset * np.linalg.norm(slope - (slope @ frame[:, :1]) * frame[:, 0], axis=-1)
        sizes = sum(np.linalg.norm(r, axis=-1) * b_size for r, _, b_size in turning)
        axial = sum(cross(r, b) for r, b, _ in turning)
        total += np.sin(angle) * np.linalg.norm(axial, axis=-1) + (1.0 - np.cos(angle)) * sizes
        total += 32.0 * LOSS * (sizes + offset * size * moment_size)
    return total


def _worst_found(grasp: Grasp, task: Task, offset: float, angle: float, budget: ForceBudget, rtol: float) -> float:
    """Return an upper bound on mu of the worst displaced grasp that is found.

    Along one direction of wrench space the displacement that leaves each contact the least support is found by trying
    all; the weakest direction of the grasp so displaced is the next one.
    """
    bounds = mu(grasp, task, rtol, force_budget=budget)
    best = bounds.upper
    for _ in range(8):
        if bounds.worst_direction is None or best == 0.0:
            break
        places, frames = grasp.points.copy(), grasp.frames.copy()
        for i, contact in enumerate(grasp.contacts):
            p, R = _displacements(grasp.points[i], grasp.frames[i], offset, angle)
            single = _with_frames(grasp, p, R, [contact] * len(p))
            work = (bounds.worst_direction @ single.G).reshape(len(p), -1)
            worst = int(np.argmin(np.linalg.norm(contact.project(work), axis=1)))
            places[i], frames[i] = p[worst], R[worst]
        bounds = mu(_with_frames(grasp, places, frames, grasp.contacts), task, rtol, force_budget=budget)
        if bounds.upper >= best:
            break
        best = bounds.upper
    return best


def _with_frames(grasp: Grasp, points: FloatArray, frames: FloatArray, contacts: Sequence[ContactModel]) -> Grasp:
    """Return a grasp with contacts at other points, in other frames."""
    tangents = frames[:, :, 1:].transpose(0, 2, 1)
    return Grasp(points, frames[:, :, 0], contacts, grasp.torque_origin, tangents, grasp.force_unit)


def _displacements(point: FloatArray, frame: FloatArray, offset: float, angle: float) -> tuple[FloatArray, FloatArray]:
    """Return places (m, space) and frames (m, space, space) of a displaced contact: all of both, and none.

    Places are on a ring around the stated one; frames are turned about axes along the face, and about the normal.
    """
    space = len(point)
    if space == 2:
        ring = np.concatenate([np.zeros((1, 2)), frame[:, 1:].T, -frame[:, 1:].T])
        axes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    else:
        turns = 2.0 * np.pi * np.arange(12) / 12
        ring = np.concatenate([np.zeros((1, 3)), np.stack([np.cos(turns), np.sin(turns)], axis=1) @ frame[:, 1:].T])
        axes = np.concatenate([ring, frame[:, :1].T, -frame[:, :1].T])
    rotations = Rotation.from_rotvec(angle * axes).as_matrix()[:, :space, :space]
    places, turned = (grid.ravel() for grid in np.meshgrid(np.arange(len(ring)), np.arange(len(axes))))
    return point + offset * ring[places], (rotations @ frame)[turned]
