"""Least quality over all displacements of the contacts, turns of their frames and losses of friction.

A displaced contact is at ``p + d``, d along its stated face, and its frame is turned by a rotation Q of an angle of at
most a. Forces are chosen once, from narrower cones, and remain admissible in every displaced grasp:

- *Contacts with friction* f exert the same forces in the body frame. With ``(|f_t| / f, |m| / f_m) <= r f_n`` about the
  stated normal and

      r = (cos a - sin a / f) / (1 + f sin a),

  a force is within the contact's own cone about every normal at an angle of at most a: |f_t| grows by at most
  f_n sin a, f_n falls by at most |f_t| sin a. The corners of a pad turn with it, from R c to Q R c. Moments turn with
  the frame; those that a pad's shape limits are exerted s-fold, ``s = cos a - r f sin a``, as f_n falls by no more.
- *Contacts without* exert the same components in the turned frame, which remain admissible.

All forces are divided by what budgets may count them more in a displaced grasp: f_n grows to at most
``cos b + r f sin b`` times itself, at the tilt ``b = min(a, arctan r f)``, and the moment of forces u_c at the corners
of a pad by at most ``2 sin(a / 2) max |c| sum |u_c|``.

So a displaced grasp exerts ``(G + D) x`` with the same x. Along (a_f, a_m) it is less than ``G x`` by at most

    -<a_m, d x F> - sum_j <(Q - I) r_j, b_j>  <=  offset |t| + sin a |sum_j r_j x b_j| + (1 - cos a) sum_j |r_j| |b_j|

where t is the part of ``F x a_m`` along the face, and r_j are the vectors that turn: arms R c with ``b = u_c x a_m``
for a force u_c at a corner, moments with ``b = a_m``, turned forces with ``b = a_f + a_m x (p - o)`` (by Rodrigues'
formula ``Q - I = sin k^ + (1 - cos) (k k^T - I)``; in the plane all of this is embedded in space). Two bounds follow.

1. *Of each vertex*: the cells of an inner polytope of these wrenches keep their heights less these losses at their
   vertices, and still surround a point of the scaled task (``provable_lower``).
2. *Of all forces*: with an ellipsoid or a sum of them, E = -E, that contains every D x, ``q T + E`` inside W, the
   wrenches G x, proves q of every displaced grasp. The support of its wrenches along any y is at least
   ``<y, (G + D) x>`` for the x that attains that of W, hence at least ``phi_W(y) - phi_E(y) >= q phi_T(y)``. This is an
   ordinary statement on mu of a grasp with narrower cones (``robust_claim``), and somewhat weaker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets import force_budget as find_budget
from nlpgrasp.common.spatial import cross, cross_matrix, in_space
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
from nlpgrasp.quality.ratio_minimisation import minimise_by_inverse_iteration
from nlpgrasp.quality.sandwich import SHRINK, inner_points, tighten
from nlpgrasp.quality.screening import GraspBatch
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task, TaskEllipsoid


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
    displaced = _DisplacedGrasps.of(grasp, task, offset, angle, friction_loss, force_budget)
    stated = mu(displaced.weaker, displaced.task, max(rtol, 0.1), force_budget=displaced.budget)
    if stated.worst_direction is None or stated.upper == 0.0:
        return Bounds(0.0, stated.upper, kind="robust_mu")
    lower, limiting = displaced.lower_end(0.7 * stated.upper, rtol)
    upper, directions = stated.upper, np.concatenate([stated.worst_direction[None], limiting])
    for width in (max(rtol, 0.1), rtol):
        bounds = mu(displaced.worst_found(directions), displaced.task, width, force_budget=displaced.budget)
        upper = min(upper, bounds.upper)
        if bounds.worst_direction is None or upper == 0.0:
            break
        directions = bounds.worst_direction[None]
    return Bounds(min(lower, upper), upper, kind="robust_mu")


def robust_claim(
    grasp: Grasp,
    task: Task,
    lower: float,
    offset: float = 0.001,
    angle: float = 0.09,
    friction_loss: float = 0.1,
    *,
    force_budget: str | ForceBudget = "l2",
) -> tuple[Grasp, Task]:
    """Return a grasp and a task whose mu is at least 1 only if every displaced grasp has mu of at least ``lower``.

    They are the grasp with narrower cones, and the ``lower``-fold task plus all changes of wrenches by displacements.
    So ``ng.write_proof(*ng.robust_claim(grasp, task, lower), path, force_budget=...)`` proves ``lower`` if the interval
    that it returns is above 1. The lower end of ``robust_mu`` itself has no such file: this reaches less.

    Parameters
    ----------
    grasp, task, offset, angle, friction_loss, force_budget
        As for ``robust_mu``.
    lower : float
        Multiple of the task, above 0.

    Raises
    ------
    InputError
        As ``robust_mu``, and where friction holds no force under all normals.
    """
    lower = number("lower", lower, above=0.0)
    displaced = _DisplacedGrasps.of(grasp, task, offset, angle, friction_loss, force_budget)
    claim = displaced.claim(lower)
    if claim is None:
        raise InputError("angle", angle, "radians, below the angle of friction that is left")
    return claim


@dataclass(frozen=True)
class _DisplacedGrasps:
    """All displaced grasps of one grasp.

    Parameters
    ----------
    weaker : Grasp
        In its stated place, with the least friction.
    task : Task
    offset, angle : float
        Metres and radians.
    budget : ForceBudget
    """

    weaker: Grasp
    task: Task
    offset: float
    angle: float
    budget: ForceBudget

    @classmethod
    def of(
        cls, grasp: Grasp, task: Task, offset: float, angle: float, loss: float, force_budget: str | ForceBudget
    ) -> _DisplacedGrasps:
        """Return the displaced grasps of checked input."""
        require_grasp(grasp)
        task = task_for(task, grasp)
        offset = number("offset", offset, at_least=0.0)
        angle = number("angle", angle, at_least=0.0)
        if angle > 0.5:
            raise InputError("angle", angle, "radians, at most 0.5")
        loss = number("friction_loss", loss, at_least=0.0)
        if loss >= 1.0:
            raise InputError("friction_loss", loss, "a share below 1")
        budget = find_budget(force_budget)
        if budget.depends_on_frames or not (budget.limited or budget.bounds_fingers):
            raise InputError("force_budget", budget.kind, "a limit on sizes of forces or on normal forces")
        return cls(grasp.with_friction(1.0 - loss), task, offset, angle, budget)

    @cached_property
    def guard(self) -> float:
        """Radians that count with the angle: frames are orthonormal but for rounding, and cones are rounded."""
        frames = self.weaker.frames
        error = np.abs(frames.transpose(0, 2, 1) @ frames - np.eye(self.weaker.space))
        return 16.0 * (float(np.max(error)) + LOSS)

    @cached_property
    def narrowed(self) -> list[_NarrowedContact] | None:
        """Contacts with narrower cones; None if friction holds no force of one of them under all normals."""
        is_normal_limited, angle = bool(self.budget.limited), self.angle + self.guard
        contacts = [_NarrowedContact.of(c, angle, self.weaker.space, is_normal_limited) for c in self.weaker.contacts]
        return [c for c in contacts if c is not None] if None not in contacts else None

    def claim(self, lower: float) -> tuple[Grasp, Task] | None:
        """Return the grasp with narrower cones, and the task plus all changes of its wrenches."""
        if self.narrowed is None:
            return None
        given, errors = self.weaker, list[FloatArray]()
        unit = given.force_unit / (max(c.growth for c in self.narrowed) * (1.0 + self.guard))
        models = [c.model for c in self.narrowed]
        grasp = Grasp(given.points, given.normals, models, given.torque_origin, given.tangents, unit)
        points, origin = in_space(given.points), in_space(given.torque_origin[None])[0]
        turn = 2.0 * np.sin(0.5 * (self.angle + self.guard))
        used = [0, 1, 5] if given.space == 2 else list(range(6))
        for contact, p in zip(self.narrowed, points, strict=True):
            force, moment = contact.largest(given.space, bool(self.budget.limited))
            arm = max((float(np.hypot(*corner)) for corner in contact.corners), default=0.0)
            error = self.offset * force + turn * (moment if not contact.corners else arm * force)
            error += (1.0 - contact.share) * moment
            error += LOSS * force * float(np.linalg.norm(p) + np.linalg.norm(origin))  # rounding of moments
            axes = np.pad(error * np.eye(3), ((0, 0), (3, 0)))
            if not contact.keeps_forces:  # Q F - F at p; a sum of two ellipsoids is within one of both, sqrt(2)-fold
                turned = turn * force * np.concatenate([np.eye(3), cross_matrix(p - origin).T], axis=1)
                axes = np.sqrt(2.0) * np.concatenate([axes, turned])
            errors.append(unit * (1.0 + self.guard) * axes[:, used])
        # sizes of forces whose squares, or which themselves, add up to 1 at most
        is_one_ellipsoid = self.budget.kind in ("l2", "shared")
        parts = [np.concatenate(errors)] if is_one_ellipsoid else errors
        enlarged = self.task * (lower * (1.0 + self.guard))
        for axes in filter(np.any, parts):
            enlarged = enlarged + TaskEllipsoid.from_axes(axes).given_about(given.torque_origin)
        return grasp, enlarged

    def lower_end(
        self, aim: float, rtol: float, rounds: int = 4, batch: int = 24, weakest: int = 7
    ) -> tuple[float, FloatArray]:
        """Return a lower bound on mu of every displaced grasp, and directions (m, d) of the cells that limit it.

        The inner polytope of the ordinary claim that ``aim`` is held is refined in some rounds, each by a batch of
        vertices beyond the cells whose heights less their losses are least for the task.
        """
        claim, directions = self.claim(aim), np.zeros((0, self.weaker.dimension))
        if claim is None or self.narrowed is None:
            return 0.0, directions
        grasp, enlarged = claim
        wrenches = WrenchSet.of(grasp, self.budget)
        problem, _ = make_containment(wrenches, enlarged)
        if problem is None or problem.rank < grasp.dimension:
            return 0.0, directions
        state = tighten(problem, rtol)
        if state.hull is None or state.upper == 0.0:
            return 0.0, directions
        domain, rng = ForceCones.of(wrenches), np.random.default_rng(0)
        factors = np.concatenate([c.moment_shares(grasp.space) for c in self.narrowed])
        best, stalled = 0.0, 0
        for _ in range(rounds):
            variables, cells = state.hull.vertices()
            variables = domain.into(variables) * factors
            planes = state.hull.cell_planes() @ problem.matrix
            losses = self._losses(grasp, variables, planes, cells)
            lower = (
                provable_lower(wrenches, variables, cells, planes, self.task, losses) if state.hull.is_sound else 0.0
            )
            offsets = np.min(np.einsum("fvd,fd->fv", wrenches.exert(variables)[cells], planes) - losses, axis=1)
            reach = self.task.support(planes)[0]
            beside = np.where(offsets < 0.0, -np.inf, np.inf)
            multiples = np.where(reach > 0.0, offsets / np.where(reach > 0.0, reach, 1.0), beside)
            order = np.argsort(multiples)[:batch]
            stalled = stalled + 1 if 0.0 < lower <= best * (1.0 + 0.1 * rtol) else 0
            if lower > best or not len(directions):
                best, directions = lower, planes[order[:weakest]]
            new = problem.wrenches.variables(state.hull.cell_planes()[order])[1]
            if stalled == 2 or not state.hull.insert(*inner_points(problem, new, SHRINK, rng)):
                break
        return best, directions

    def _losses(self, grasp: Grasp, variables: FloatArray, planes: FloatArray, cells: IntArray) -> FloatArray:
        """Return by how much displacements lower each vertex of each cell along the cell's plane, (f, d)."""
        space, start, total = grasp.space, 0, np.zeros(cells.shape)
        offset, angle = self.offset, self.angle + self.guard
        a_force = in_space(planes[:, :space])
        a_moment = np.zeros_like(a_force)
        a_moment[:, 3 - (grasp.dimension - space) :] = planes[:, space:]  # in the plane about the third axis
        a_size = np.linalg.norm(a_moment, axis=1)[:, None]
        points, origin = in_space(grasp.points), in_space(grasp.torque_origin[None])[0]
        for contact, p, stated in zip(self.narrowed or (), points, grasp.frames, strict=True):
            frame = np.eye(3)
            frame[:space, :space] = stated
            factors = contact.moment_shares(space)
            u = grasp.force_unit * variables[:, start : start + len(factors)]  # (v, l)
            start += len(factors)
            # of each vertex: sum_j r_j x b_j = turning a_m, and sum_j |r_j| |b_j| = size |a_m| but for turned forces
            if contact.corners:
                arms = np.array(contact.corners) @ frame[:, 1:].T
                at_corners = u.reshape(len(u), -1, 3) @ frame.T  # (v, corners, 3)
                force, sizes = np.sum(at_corners, axis=1), np.linalg.norm(at_corners, axis=2)
                turning = np.einsum("vci,cj->vij", at_corners, arms)  # r x (u x a) = u <r, a> - a <r, u>
                turning -= np.trace(turning, axis1=1, axis2=2)[:, None, None] * np.eye(3)
                force_size, size = np.sum(sizes, axis=1), sizes @ np.linalg.norm(arms, axis=1)
            else:
                local = np.zeros((len(u), 6))
                local[:, [(0, 1, 5)[c] if space == 2 else c for c in contact.model.axes(space)]] = u
                force, moment = local[:, :3] @ frame.T, local[:, 3:] @ frame.T
                turning, force_size = cross_matrix(moment), np.linalg.norm(force, axis=1)
                size = np.linalg.norm(moment, axis=1)
            axial = np.einsum("fvij,fj->fvi", turning[cells], a_moment)
            products = size[cells] * a_size
            if not contact.keeps_forces:
                b = a_force + cross(a_moment, p - origin)
                b_size = np.linalg.norm(a_force, axis=1)[:, None] + a_size * (
                    np.linalg.norm(p) + np.linalg.norm(origin)
                )
                axial = axial + cross(force[cells], b[:, None])
                products = products + force_size[cells] * b_size
                total += offset * 2.0 * np.sin(0.5 * angle) * force_size[cells] * a_size
            slope = cross(force[cells], a_moment[:, None])  # of the work with the displacement
            total += offset * np.linalg.norm(slope - (slope @ frame[:, :1]) * frame[:, 0], axis=-1)
            total += np.sin(angle) * np.linalg.norm(axial, axis=-1) + (1.0 - np.cos(angle)) * products
            total += 32.0 * LOSS * (products + offset * force_size[cells] * a_size)
        return total

    def worst_found(self, y: FloatArray, rounds: int = 4, steps: int = 4) -> Grasp:
        """Return the worst displaced grasp that is found from directions y (b, d).

        Along each the frame, then the place, that leaves each contact the least support is found by trying all; the
        weakest direction nearby of the grasp so displaced is the next one.
        """
        given, best = self.weaker, np.inf
        force_set, worst = WrenchSet.of(given, self.budget).force_set, given
        for _ in range(rounds):
            points, frames = (np.repeat(rows[None], len(y), axis=0) for rows in (given.points, given.frames))
            for i, contact in enumerate(given.contacts):
                turned = np.repeat(_turned_frames(given.frames[i], self.angle)[None], len(y), axis=0)
                places = np.broadcast_to(given.points[i], turned.shape[:3])
                frames[:, i] = self._weakest(y, contact, places, turned)[1]
                places = np.repeat(
                    _displaced_places(given.points[i], given.frames[i], self.offset)[None], len(y), axis=0
                )
                turned = np.broadcast_to(frames[:, i, None], (*places.shape, given.space))
                points[:, i] = self._weakest(y, contact, places, turned)[0]
            grasps = [_with_frames(given, p, R, given.contacts) for p, R in zip(points, frames, strict=True)]
            batch = GraspBatch(np.stack([g.G for g in grasps]), force_set)
            weakest, ratios = minimise_by_inverse_iteration(partial(batch.quadratic, task=self.task), y[:, None], steps)
            if np.min(ratios) >= best:
                break
            best, worst, y = float(np.min(ratios)), grasps[int(np.argmin(ratios))], weakest[:, 0]
        return worst

    def _weakest(
        self, y: FloatArray, contact: ContactModel, places: FloatArray, frames: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return those of a contact's places (b, m, space) and frames with the least support along each y (b, d)."""
        b, m, space = places.shape
        single = _with_frames(
            self.weaker, places.reshape(-1, space), frames.reshape(-1, space, space), [contact] * (b * m)
        )
        work = np.einsum("bd,dbmn->bmn", y, single.G.reshape(len(single.G), b, m, -1))
        least = np.argmin(np.linalg.norm(contact.project(work), axis=2), axis=1)
        return places[np.arange(b), least], frames[np.arange(b), least]


@dataclass(frozen=True)
class _NarrowedContact:
    """A contact with narrower cones, whose forces are admissible in every displaced grasp.

    Parameters
    ----------
    model : ContactModel
    keeps_forces : bool
        Whether forces stay in the body frame, or turn with the contact's.
    corners : tuple of pairs
        Positions along both tangents of the corners whose forces are a pad's variables.
    share : float
        Share of moments that is exerted.
    growth : float
        By how much budgets count its forces more in a displaced grasp: normal forces about another normal, or the
        moment of forces at turned corners.
    """

    model: ContactModel
    keeps_forces: bool = False
    corners: tuple[tuple[float, float], ...] = ()
    share: float = 1.0
    growth: float = 1.0

    @classmethod
    def of(cls, contact: ContactModel, angle: float, space: int, is_normal_limited: bool) -> _NarrowedContact | None:
        """Return the contact with narrower cones; None if friction holds no force under all normals."""
        if not isinstance(contact, RangeContact) or "friction" not in contact.coefficients:
            return cls(contact)
        f, cos, sin = contact.coefficients["friction"], float(np.cos(angle)), float(np.sin(angle))
        r = (cos - sin / f) / (1.0 + f * sin)
        if r <= 0.0:
            return None
        sum_of_cones = contact.points(contact.components(space)) if isinstance(contact, PadContact) else None
        corners = () if sum_of_cones is None else sum_of_cones.arms
        arm = max((float(np.hypot(*corner)) for corner in corners), default=0.0)
        turned = 1.0 + 2.0 * float(np.sin(0.5 * angle)) * arm * float(np.hypot(1.0, r * f))
        share = cos - r * f * sin if isinstance(contact, PadContact) and not corners else 1.0
        tilt = min(angle, float(np.arctan(r * f)))  # about the normal of which normal forces are largest
        growth = float(np.cos(tilt) + r * f * np.sin(tilt)) if is_normal_limited else turned
        return cls(contact.with_friction(r), True, corners, share, growth)

    def largest(self, space: int, is_normal_limited: bool) -> tuple[float, float]:
        """Return bounds on the force, at the corners the sum of their sizes, and on the moment within a unit budget."""
        if not self.model.unilateral:
            return 1.0, 1.0
        axes, unit = np.array(self.model.axes(space)), np.eye(self.model.components(space))
        box = np.maximum(self.model.extreme(unit)[0], self.model.extreme(-unit)[0])  # for unit normal force
        force, moment = float(np.linalg.norm(box[axes < space])), float(np.linalg.norm(box[axes >= space]))
        if is_normal_limited:
            return force, moment
        return force if self.corners else min(force, 1.0), min(moment, 1.0)

    def moment_shares(self, space: int) -> FloatArray:
        """Return a factor for each variable: ``share`` of moments, 1 of forces."""
        if self.corners:
            return np.ones(3 * len(self.corners))
        return np.where(np.array(self.model.axes(space)) >= space, self.share, 1.0)


def _with_frames(grasp: Grasp, points: FloatArray, frames: FloatArray, contacts: Sequence[ContactModel]) -> Grasp:
    """Return a grasp with contacts at other points, in other frames."""
    tangents = frames[:, :, 1:].transpose(0, 2, 1)
    return Grasp(points, frames[:, :, 0], contacts, grasp.torque_origin, tangents, grasp.force_unit)


def _displaced_places(point: FloatArray, frame: FloatArray, offset: float) -> FloatArray:
    """Return places (m, space) of a displaced contact: the stated one and a ring around it on the face."""
    return np.concatenate([point[None], point + offset * _ring(frame)])


def _turned_frames(frame: FloatArray, angle: float) -> FloatArray:
    """Return turned frames (m, space, space): the stated one, and turned about axes of all directions."""
    space, ring, normal = len(frame), _ring(frame), frame[:, :1].T
    if space == 2:
        axes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    else:
        oblique = np.sqrt(0.5) * np.concatenate([ring + normal, ring - normal])
        axes = np.concatenate([np.zeros((1, 3)), ring, oblique, normal, -normal])
    return np.asarray(Rotation.from_rotvec(angle * axes).as_matrix()[:, :space, :space] @ frame)


def _ring(frame: FloatArray) -> FloatArray:
    """Return unit vectors (m, space) along a face, evenly spaced."""
    turns = 2.0 * np.pi * np.arange(12) / 12
    around = np.array([[1.0], [-1.0]]) if len(frame) == 2 else np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.asarray(around @ frame[:, 1:].T)
