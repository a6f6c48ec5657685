"""Least quality over all displacements of the contacts, tilts of their normals and losses of friction.

With the sizes ``(|f_t| / f, |m| / f_m) <= r f_n`` of a force about the stated normal and

    r = (cos a - sin a / f) / (1 + f sin a),

the force is within the contact's own cone about every normal at an angle of at most a, also with a torsional moment m
(|f_t| grows by at most f_n sin a, f_n falls by at most |f_t| sin a). So forces chosen once, in the body frame, from
cones narrowed by r stay admissible. The contact exerts them at another point, ``p + d``, which adds ``d x f``.
In the inner polytope of these forces (``quality.sandwich``) the plane ``<a, w - c> <= h`` of a cell keeps the height

    h - max over its vertices of sum_i offset |t_i|,      t_i the part of f_i x a_m along the face,

whatever the displacements. The cells stay closed, and while these heights are positive they never pass through the
centre on the way from the stated places to others, so they still surround it: the scaled task that fits all half-spaces
is exerted by every displaced grasp. Forces of contacts without friction, and torsional moments, turn with the normal,
by ``2 sin(a / 2)`` of their size.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets import force_budget as find_budget
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.validation import FloatArray, IntArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu
from nlpgrasp.quality.provable_ends import held_multiple
from nlpgrasp.quality.sandwich import tighten
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task

ROUNDING = 1e-9  # relative guard against rounding


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
        Radians: largest angle of each normal to the stated one.
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
    other = next((c for c in grasp.contacts if c.unilateral and max(c.axes(grasp.space)) > grasp.space), None)
    if other is not None:
        raise InputError("grasp.contacts", other.kind, "contacts at a point: point, friction or soft")
    weaker = grasp.with_friction(1.0 - loss)
    upper = _worst_found(weaker, task, offset, angle, budget, rtol)
    lower = min(_lower_end(weaker, task, offset, angle, budget, rtol), upper)
    return Bounds(lower, upper, kind="robust_mu")


def _lower_end(grasp: Grasp, task: Task, offset: float, angle: float, budget: ForceBudget, rtol: float) -> float:
    """Return a lower bound on mu for every displaced grasp."""
    models, growth = [], 1.0
    for contact in grasp.contacts:
        friction = contact.coefficients.get("friction")
        share = 1.0
        if friction is not None:
            share = (np.cos(angle) - np.sin(angle) / friction) / (1.0 + friction * np.sin(angle))
            growth = max(growth, float(np.cos(angle) + share * friction * np.sin(angle)))
        if share <= 0.0:
            return 0.0
        models.append(contact.with_friction(float(share)))
    inner = Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents, grasp.force_unit)
    wrenches = WrenchSet.of(inner, budget)
    problem, _ = make_containment(wrenches, task)
    if problem is None or problem.rank < grasp.dimension:
        return 0.0
    state = tighten(problem, rtol)
    if state.hull is None or state.upper == 0.0:
        return 0.0
    forces, cells = state.hull.vertices()
    if budget.limited:  # a limit on normal forces, which are larger by this at most along another normal
        forces = forces / growth
    centre = np.asarray(np.linalg.solve(problem.matrix, state.hull.centre), dtype=np.float64)
    vertices = forces @ wrenches.G.T - centre
    unit = 1.0 / np.max(np.abs(vertices), axis=0)
    planes = np.linalg.solve(vertices[cells] * unit, np.ones((*cells.shape, 1)))[:, :, 0] * unit
    heights = np.einsum("fvd,fd->fv", vertices[cells], planes) - _losses(inner, forces, planes, cells, offset, angle)
    least = np.min(heights, axis=1)
    if np.min(least) <= 0.0:
        return 0.0
    return held_multiple(least + planes @ centre, task.support(planes)[0], ROUNDING)


def _losses(
    grasp: Grasp, forces: FloatArray, planes: FloatArray, cells: IntArray, offset: float, angle: float
) -> FloatArray:
    """Return by how much displacements lower each vertex of each cell along the cell's plane, (f, v)."""
    turn = 2.0 * np.sin(0.5 * angle)
    wrenches = grasp.contact_wrenches(forces)  # (v, k, d), moments about the contacts
    space, total = grasp.space, np.zeros(cells.shape)
    a_force, a_moment = planes[:, :space], planes[:, space:]
    for i, (contact, normal) in enumerate(zip(grasp.contacts, grasp.normals, strict=True)):
        force, moment = wrenches[cells, i, :space], wrenches[cells, i, space:]  # (f, v, space or 1)
        if space == 3:
            slope = np.cross(force, a_moment[:, None])  # of <a_m, d x f> with d
            arm = np.cross(a_moment, grasp.points[i] - grasp.torque_origin)
        else:
            slope = a_moment[:, None] * np.stack([force[..., 1], -force[..., 0]], axis=-1)
            r = grasp.points[i] - grasp.torque_origin
            arm = a_moment * np.array([-r[1], r[0]])
        along_face = slope - np.sum(slope * normal, axis=-1, keepdims=True) * normal
        total += offset * np.linalg.norm(along_face, axis=-1)
        size = np.linalg.norm(a_moment, axis=1)[:, None]
        total += turn * np.linalg.norm(moment, axis=-1) * size
        if "friction" not in contact.coefficients:
            reach = np.linalg.norm(a_force + arm, axis=1)[:, None] + offset * size
            total += turn * np.linalg.norm(force, axis=-1) * reach
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
        points, normals = grasp.points.copy(), grasp.normals.copy()
        for i, contact in enumerate(grasp.contacts):
            p, n = _displacements(grasp.points[i], grasp.normals[i], offset, angle)
            single = Grasp(p, n, [contact] * len(p), grasp.torque_origin)
            work = (bounds.worst_direction @ single.G).reshape(len(p), -1)
            worst = int(np.argmin(np.linalg.norm(contact.project(work), axis=1)))
            points[i], normals[i] = p[worst], n[worst]
        bounds = mu(Grasp(points, normals, grasp.contacts, grasp.torque_origin), task, rtol, force_budget=budget)
        if bounds.upper >= best:
            break
        best = bounds.upper
    return best


def _displacements(point: FloatArray, normal: FloatArray, offset: float, angle: float) -> tuple[FloatArray, FloatArray]:
    """Return places and inward normals of a displaced contact, (m, space) each: all of both rings, and none."""
    axes = tangents(normal[None])[0]
    if len(axes) == 1:
        ring = np.concatenate([np.zeros((1, 2)), axes, -axes])
    else:
        turns = 2.0 * np.pi * np.arange(12) / 12
        ring = np.concatenate([np.zeros((1, 3)), np.cos(turns)[:, None] * axes[0] + np.sin(turns)[:, None] * axes[1]])
    places, tilts = (grid.ravel() for grid in np.meshgrid(np.arange(len(ring)), np.arange(len(ring))))
    tilted = np.where(tilts[:, None] > 0, np.cos(angle) * normal + np.sin(angle) * ring[tilts], normal)
    return point + offset * ring[places], tilted
