"""One step of many postures of a hand: mu and all limits linearised side by side, and a quadratic program for each.

The variables are the twist of the palm and the joints alone. A fingertip touches with the point of its patch nearest to
the body: contact and normal follow from the body's smooth surface. mu is bounded by its weakest directions (Li and
Sastry 1986, equation 3.4-3). Links are samples of their shapes, in pairs the shapes themselves; the largest gap of
a fingertip and the largest lack of clearance have a price.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import daqp
import numpy as np

from nlpgrasp.bodies.distance_grid import DistanceGrid
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.spatial import cross
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.moving_links import Frames, HandState
from nlpgrasp.motion.link_parts import BinnedPoints
from nlpgrasp.optimize.hand_shapes import HandShapes
from nlpgrasp.optimize.race_limits import PosedContacts, RaceLimits
from nlpgrasp.optimize.solids import HasDistance
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.ratio_minimisation import minimise_by_inverse_iteration
from nlpgrasp.quality.screening import GraspBatch, fixed_force_set, second_moment, spread_directions

CUTS = 32  # weak directions of a posture, at most


@dataclass
class Racer:
    """A posture with mu and all limits linearised at it, and its trust region.

    Parameters
    ----------
    state : HandState
        One posture.
    mu : float
        Least support ratio found.
    points, normals : (k, 3) arrays
        Contacts, metres, and inward unit normals.
    moving, turning : (k, 3, n) arrays
        Derivatives of contacts and of inward normals by the twist.
    cuts, ratios, slopes : (m, d), (m,) and (m, n) arrays
        Weak directions with ``phi_A = 1``, the supports there and their derivatives by the twist.
    gaps, touch : (k,) and (k, n) arrays
        Distances of the fingertips from the body, metres, and their derivatives.
    values, rows : (r,) and (r, n) arrays
        What must not be negative and may become so, metres, and the derivatives.
    linkages : (l, n) array
        Rows whose product with a twist has to be zero: what keeps linkages closed.
    pivot : (3,) array
        Of the twist.
    radius : float
        Of the trust region, metres.
    idle : int
        Steps in a row that hardly gained.
    """

    state: HandState
    mu: float
    points: FloatArray
    normals: FloatArray
    moving: FloatArray
    turning: FloatArray
    cuts: FloatArray
    ratios: FloatArray
    slopes: FloatArray
    gaps: FloatArray
    touch: FloatArray
    values: FloatArray
    rows: FloatArray
    linkages: FloatArray
    pivot: FloatArray
    radius: float = 8e-3
    idle: int = 0

    @property
    def lack(self) -> float:
        """Largest gap of a fingertip and largest lack of clearance together, metres."""
        return float(np.max(np.abs(self.gaps))) - float(np.min(self.values, initial=0.0))

    def merit(self, price: float) -> float:
        """Return mu less the price, a metre, of what the posture lacks."""
        return self.mu - price * self.lack


@dataclass(frozen=True)
class Touch:
    """Contacts of the fingertips of b postures with the smooth surface of the body.

    Parameters
    ----------
    centres : (b, k, 3) array
        Of the balls at which the fingertips touch, metres.
    gaps : (b, k) array
        Of the balls from the surface, metres.
    points, normals : (b, k, 3) arrays
        Contacts, metres, and outward unit normals.
    by_centre, turning : (b, k, 3, 3) arrays
        Derivatives of contacts and of outward normals by the centres.
    """

    centres: FloatArray
    gaps: FloatArray
    points: FloatArray
    normals: FloatArray
    by_centre: FloatArray
    turning: FloatArray


@dataclass(frozen=True)
class Pads:
    """Places of the contacts on the s fingertips of b postures along which they slide.

    Parameters
    ----------
    sides : (b, s, 2, 3) array
        Unit vectors along sides or axes, body frame.
    places : (b, s, 2) array
        Of the contacts from the middles along these, metres.
    slopes, stiffness : (b, s, 2) and (b, s, 2, 2) arrays
        Derivatives by the place of what is least there.
    """

    sides: FloatArray
    places: FloatArray
    slopes: FloatArray
    stiffness: FloatArray


class RaceSteps:
    """Linearisation and steps of a problem's hand.

    Parameters
    ----------
    problem : GraspProblem
    shapes : HandShapes
    grid : DistanceGrid
        Of the body.
    solids : HasDistance
        Body and surroundings.
    body_edges : BinnedPoints
        Points of the body's sharp edges, which are kept outside links.
    budget : ForceBudget
        One that does not depend on the contacts' frames.
    limits : RaceLimits
        Of the problem.
    rng : numpy.random.Generator

    Attributes
    ----------
    unit : float
        mu of a good grasp, to which prices and gains are relative.
    """

    def __init__(
        self, problem: GraspProblem, shapes: HandShapes, grid: DistanceGrid, solids: HasDistance,
        body_edges: BinnedPoints, budget: ForceBudget, limits: RaceLimits, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.problem, self.shapes, self.grid, self._budget, self._rng = problem, shapes, grid, budget, rng
        self.limits, self.solids, self.body_edges = limits, solids, body_edges
        self.unit = 1.0

    def screen(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return bounds on mu at contacts (b, k, 3) with inward normals, (b,), and set unit and metric of the task."""
        stack = self._stack(points, normals)
        self._forces, task = fixed_force_set(stack, self._budget), self.problem.task
        self._metric = np.linalg.cholesky(second_moment(stack, task))
        y = spread_directions(stack, task)
        supports = GraspBatch(stack.G, self._forces).support(np.broadcast_to(y, (len(stack), *y.shape)))
        ratios = supports / task.support(y)[0]
        mu = np.asarray(np.min(ratios, axis=1))
        self.unit = float(np.quantile(mu, 0.95)) or 0.1 * float(np.mean(ratios))
        return mu

    @cached_property
    def is_one_sided(self) -> bool:
        """Whether the task pushes from some sides alone: contacts may exert it without pressing on each other."""
        y = np.random.default_rng(0).standard_normal((500, len(self._metric))) @ np.linalg.inv(self._metric)
        return bool(np.min(self.problem.task.support(y)[0]) <= 0.0)

    def grasp(self, racer: Racer) -> Grasp:
        """Return the grasp at a racer's contacts."""
        return Grasp(racer.points, racer.normals, self.problem.models, self.problem.origin)

    def first(self, state: HandState) -> list[Racer]:
        """Return racers in given postures, whose weak directions are not known yet; after ``screen``."""
        y = self._random_directions(len(state), CUTS)
        return self.linearise(state, y / self.problem.task.support(y.reshape(-1, y.shape[2]))[0].reshape(len(y), -1, 1))

    def touch(self, frames: Frames, steps: int = 4) -> Touch:
        """Return the contacts of the fingertips in b postures: of each patch's point that is nearest to the body.

        On flat patches and along axes it is found by Newton steps from the nearest sample. Contacts take ``steps`` of
        them; gaps need fewer, for they are stationary there.
        """
        tips, nearest = self.shapes.tips, self.nearest_samples(frames)
        result = self._contacts(nearest, steps)
        for _ in range(3 if len(tips.sliding) else 0):
            pads = self._pads(frames, result)
            step = -np.linalg.solve(pads.stiffness, pads.slopes[..., None])[..., 0]
            places = np.clip(pads.places + step, -tips.halves, tips.halves)
            middles = frames.points(tips.middles, tips.groups[tips.sliding])
            nearest[:, tips.sliding] = middles + np.einsum("bfa,bfax->bfx", places, pads.sides)
            result = self._contacts(nearest, steps)
        return result

    def nearest_samples(self, frames: Frames) -> FloatArray:
        """Return the sample nearest to the body of each fingertip's patch in b postures, (b, k, 3), metres."""
        shapes, tips = self.shapes, self.shapes.tips
        starts, index = shapes.patch_starts, np.tile(shapes.patch_starts, (len(frames.R), 1))
        if len(starts) < len(shapes.patches.at):
            points = frames.cloud(shapes.patches)
            distances = self.grid.nearest(points).astype(float)
            sizes = np.diff(starts, append=points.shape[1])
            least = np.repeat(np.minimum.reduceat(distances, starts, axis=1), sizes, axis=1)
            which, near = np.nonzero(distances < least + 1.2 * self.grid.spacing)
            distances[:] = np.inf
            distances[which, near] = self.grid.distance(points[which, near].astype(float))[0]
            for i, (start, size) in enumerate(zip(starts, sizes, strict=True)):
                index[:, i] += np.argmin(distances[:, start : start + size], axis=1)
        R, t = frames.R[:, tips.groups], frames.t[:, tips.groups]
        return np.asarray((R @ shapes.patches.at[index][..., None])[..., 0] + t)

    def ball_centres(self, frames: Frames) -> FloatArray:
        """Return where balls may stand for the fingertips, (b, k, 3), metres: nearest to the body where they slide."""
        tips = self.shapes.tips
        centres = frames.points(tips.at, tips.groups)
        if len(tips.sliding):
            centres[:, tips.sliding] = self.nearest_samples(frames)[:, tips.sliding]
        return centres

    def _pads(self, frames: Frames, touch: Touch, pull: float = 0.1) -> Pads:
        """Return where contacts slide to, as minima of the distance over each pad or axis.

        To the distance ``pull`` / 2 times the square of that from the middle is added, which decides on a flat face.

        Parameters
        ----------
        frames : Frames
        touch : Touch
            With the contacts' present places.
        pull : float
            One over metres.
        """
        tips = self.shapes.tips
        groups = tips.groups[tips.sliding]
        sides = np.stack([frames.directions(tips.along[:, axis], groups) for axis in range(2)], axis=2)
        offsets = touch.centres[:, tips.sliding] - frames.points(tips.middles, groups)
        places = np.einsum("bfax,bfx->bfa", sides, offsets)
        slopes = np.einsum("bfax,bfx->bfa", sides, touch.normals[:, tips.sliding]) + pull * places
        stiffness = sides @ touch.turning[:, tips.sliding] @ sides.transpose(0, 1, 3, 2) + pull * np.eye(2)
        return Pads(sides, places, slopes, stiffness)

    def _with_rolling(self, frames: Frames, touch: Touch, motion: FloatArray) -> FloatArray:
        """Return the motion (b, k, 3, n) of contacts' centres by the twist, with what they slide.

        A contact stays where the distance over pad or axis is least, as far as that reaches.
        """
        tips = self.shapes.tips
        if not len(tips.sliding):
            return motion
        pads, result, sliding = self._pads(frames, touch), motion.copy(), tips.sliding
        at_end = (np.abs(pads.places) > tips.halves - 1e-9) & (pads.places * pads.slopes < 0.0)
        stiffness = pads.stiffness + 1e6 * at_end[..., None] * np.eye(2)
        which, tip = np.repeat(np.arange(len(motion)), len(sliding)), np.tile(sliding, len(motion))
        rates = pads.sides @ touch.turning[:, sliding] @ motion[:, sliding]
        for axis in range(2):
            turned = cross(pads.sides[:, :, axis], touch.normals[:, sliding]).reshape(-1, 3)
            rates[:, :, axis] += frames.turning_rows(turned, tips.groups[tip], which).reshape(*rates.shape[:2], -1)
        result[:, sliding] -= pads.sides.transpose(0, 1, 3, 2) @ np.linalg.solve(stiffness, rates)
        return result

    def _contacts(self, centres: FloatArray, steps: int) -> Touch:
        """Return the contacts of balls with centres (b, k, 3).

        The contact p of a centre c is the point of the smooth surface with ``c = p + d g(p)`` and the outward normal g,
        by Newton steps from the nearest one. With the surface's curvature S at p, ``dp = (I + d S)^-1 dc`` along it and
        ``dg = S dp``.
        """
        c = centres.reshape(-1, 3)
        d, g, _ = self.grid.smooth_distance(c)
        p = c - d[:, None] * g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-9)
        for step in range(steps + 1):
            h, g, H = self.grid.smooth_distance(p)
            slope = np.maximum(np.linalg.norm(g, axis=1), 1e-9)
            g = g / slope[:, None]
            d = np.sum((c - p) * g, axis=1)
            along = np.eye(3) - g[:, :, None] * g[:, None, :]
            curvatures, axes = np.linalg.eigh(along @ (H / slope[:, None, None]) @ along)
            shares = 1.0 / np.maximum(1.0 + d[:, None] * curvatures, 0.3)  # a ball in a hollow as tight as itself
            by_centre = (axes * shares[:, None, :]) @ axes.transpose(0, 2, 1) @ along
            if step < steps:
                move = (by_centre @ (c - p)[:, :, None])[..., 0]
                move *= np.minimum(1.0, 4e-3 / np.maximum(np.linalg.norm(move, axis=1, keepdims=True), 1e-12))
                p = p + move - (h / slope)[:, None] * g
        turning = (axes * (curvatures * shares)[:, None, :]) @ axes.transpose(0, 2, 1)
        gaps = d.reshape(centres.shape[:2]) - self.shapes.tips.standoffs
        matrices = (*centres.shape, 3)
        return Touch(
            centres, gaps, p.reshape(centres.shape), g.reshape(centres.shape), by_centre.reshape(matrices),
            turning.reshape(matrices),
        )  # fmt: skip

    # ---- linearisation ----------------------------------------------------------------------------------------------
    def linearise(self, state: HandState, known: FloatArray) -> list[Racer]:
        """Return racers in given postures, with known weak directions (b, m, d) of each."""
        frames = self.shapes.links.frames(state)
        touch = self.touch(frames)
        count, pivot = len(state), touch.centres.mean(axis=1)
        motion = self._with_rolling(frames, touch, frames.motions(touch.centres, self.shapes.tips.groups, pivot))
        moving = touch.by_centre @ motion
        turning = -touch.turning @ motion
        points, normals = touch.points, -touch.normals
        G = self._stack(points, normals).G
        cuts, ratios = self._weakest(G, known)
        slopes = self._support_slopes(G, points, normals, moving, turning, cuts)
        approaching = np.einsum("bkx,bkxn->bkn", touch.normals, motion)
        rows, values, owners = self._limits(frames, touch, motion, pivot)
        if self.limits:
            contacts = PosedContacts(state, points, normals, moving, turning, pivot)
            parts = zip((owners, values, rows), self.limits.rows(contacts), strict=True)
            owners, values, rows = (np.concatenate(pair) for pair in parts)
        linkages = self.shapes.linkage_rows(state.joints)
        order = np.argsort(owners, kind="stable")
        ends = np.searchsorted(owners[order], np.arange(count + 1))
        racers = list[Racer]()
        for i in range(count):
            real, own = np.isfinite(ratios[i]), order[ends[i] : ends[i + 1]]
            racers.append(
                Racer(
                    state.of(slice(i, i + 1)), float(np.min(ratios[i])), points[i], normals[i], moving[i], turning[i],
                    cuts[i][real], ratios[i][real], slopes[i][real], touch.gaps[i], approaching[i], values[own],
                    rows[own], linkages[i], pivot[i],
                )
            )  # fmt: skip
        return racers

    def _stack(self, points: FloatArray, normals: FloatArray) -> GraspStack:
        """Return the grasps at contacts (b, k, 3) with inward normals."""
        return GraspStack(points, normals, self.problem.models, self.problem.origin)

    def _random_directions(self, count: int, number: int) -> FloatArray:
        """Return random directions, (count, number, d), in the metric of the task."""
        random = self._rng.standard_normal((count, number, len(self._metric)))
        return np.asarray(random @ np.linalg.inv(self._metric))

    def _weakest(
        self, G: FloatArray, known: FloatArray, descents: int = 14, fresh: int = 6, steps: int = 5
    ) -> tuple[FloatArray, FloatArray]:
        """Return weak directions (b, CUTS, d) with ``phi_A = 1`` and their ratios, infinite where there are fewer.

        Descents begin from the weakest known directions (b, m, d) and from ``fresh`` random ones.
        """
        task = self.problem.task
        view = GraspBatch(G, self._forces)
        supports = view.support(known)
        order = np.argsort(supports, axis=1, kind="stable")[:, :descents, None]
        begin = [np.take_along_axis(known, order, axis=1), self._random_directions(len(known), fresh)]
        found, values = minimise_by_inverse_iteration(
            lambda u: view.quadratic(u, task), np.concatenate(begin, axis=1), steps
        )
        reach = task.support(found.reshape(-1, found.shape[2]))[0].reshape(values.shape)
        found = found / np.where(reach > 0.0, reach, 1.0)[..., None]
        values = np.where(reach > 0.0, values, np.inf)
        return self._distinct(np.concatenate([found, known], axis=1), np.concatenate([values, supports], axis=1))

    def _distinct(self, y: FloatArray, ratios: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the weakest of directions (b, m, d), at most CUTS, and ratios, infinite for one like a weaker one."""
        for alike in (False, True):  # first the order, then that without directions like a weaker one
            if alike:
                u = y @ self._metric
                u = u / np.maximum(np.linalg.norm(u, axis=2, keepdims=True), 1e-300)
                repeated = np.tril(u @ u.transpose(0, 2, 1) > 0.9995, -1).any(axis=2)
                ratios = np.where(repeated | (ratios > 1.3 * ratios[:, :1]), np.inf, ratios)
                ratios[:, 0] = np.where(np.isfinite(ratios[:, 0]), ratios[:, 0], 0.0)
            order = np.argsort(ratios, axis=1, kind="stable")[:, : CUTS if alike else None]
            y, ratios = np.take_along_axis(y, order[..., None], axis=1), np.take_along_axis(ratios, order, axis=1)
        return y, ratios

    def _support_slopes(
        self, G: FloatArray, points: FloatArray, normals: FloatArray, moving: FloatArray, turning: FloatArray,
        y: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """Return the derivatives (b, m, n) of supports along y (b, m, d) by the twist.

        With the maximising force f and torque t n of a contact at r from the torque origin, its part of the support is
        ``y_f . f + y_m . (r x f + t n)``. The force turns with the normal, by the least rotation.
        """
        z = y @ G
        x = self._forces.support(z.reshape(-1, z.shape[2]))[1].reshape(z.shape)
        slopes = np.zeros((*y.shape[:2], moving.shape[3]))
        for i, part in enumerate(self._forces.ranges):
            wrench = x[..., part] @ G[:, :, part].transpose(0, 2, 1)
            f, n, r = wrench[..., :3], normals[:, None, i], points[:, None, i] - self.problem.origin
            torque = np.sum((wrench[..., 3:] - cross(r, f)) * n, axis=2, keepdims=True)
            pull = y[..., :3] + cross(y[..., 3:], r)  # derivative of the support by the force
            by_normal = np.sum(n * f, axis=2, keepdims=True) * pull - np.sum(n * pull, axis=2, keepdims=True) * f
            slopes += cross(f, y[..., 3:]) @ moving[:, i] + (by_normal + torque * y[..., 3:]) @ turning[:, i]
        return slopes

    def _limits(
        self, frames: Frames, touch: Touch, motion: FloatArray, pivot: FloatArray, reach: float = 6e-3
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return derivatives, values, metres, and postures of what must not be negative and is near zero."""
        shapes, grid, solids, tips = self.shapes, self.grid, self.solids, self.shapes.tips
        # samples of links outside body and surroundings
        reach_of_samples = reach + float(np.max(shapes.least))
        which, index, x, value, slope = shapes.lowest_samples(solids, frames, reach_of_samples)
        groups = shapes.samples.groups[index]
        rows = [frames.rows(x, groups, slope, pivot, which)]
        values, owners = [value - shapes.least[groups]], [which]
        # points of the body outside links
        which, part, x, value, n = shapes.nearest_body_edges(self.body_edges, frames, reach_of_samples - 2e-3)
        groups = shapes.part_groups[part]
        rows.append(-frames.rows(x, groups, n, pivot, which))
        values.append(value - shapes.least[groups])
        owners.append(which)
        # parts of links apart
        which, pairs, value, ends, n = shapes.parts.near_pairs(shapes.part_frames(frames), shapes.parts.pairs, reach)
        groups = shapes.part_groups[shapes.parts.pairs[pairs]]
        sides = [frames.rows(ends[:, i], groups[:, i], n, pivot, which) for i in range(2)]
        rows.append(sides[1] - sides[0])
        values.append(value)
        owners.append(which)
        # contacts within the fingertips' patches: a hundredth of a cosine counts as a tenth of a millimetre
        limited = np.flatnonzero((tips.cosines > -1.0) & (tips.cosines < 1.0))
        which, tip = np.repeat(np.arange(len(pivot)), len(limited)), np.tile(limited, len(pivot))
        facing, n = frames.directions(tips.facing, tips.groups)[which, tip], -touch.normals[which, tip]
        turning = frames.turning_rows(cross(facing, n), tips.groups[tip], which)
        turning -= np.einsum("ix,ixy,iyn->in", facing, touch.turning[which, tip], motion[which, tip])
        rows.append(0.01 * turning)
        values.append(0.01 * (np.sum(facing * n, axis=1) - tips.cosines[tip]))
        owners.append(which)
        # sides of flat tips and axes of cylinders along the surface: sines of their angles count as cosines do
        tangent = tips.sliding[tips.tangent[:, 0]]
        which, tip = np.repeat(np.arange(len(pivot)), len(tangent)), np.tile(tangent, len(pivot))
        side = frames.directions(tips.along[tuple(tips.tangent.T)], tips.groups[tangent]).reshape(-1, 3)
        n = -touch.normals[which, tip]
        turning = frames.turning_rows(cross(side, n), tips.groups[tip], which)
        turning -= np.einsum("ix,ixy,iyn->in", side, touch.turning[which, tip], motion[which, tip])
        sines = np.sum(side * n, axis=1)
        for sign in (0.01, -0.01):
            rows.append(sign * turning)
            values.append(sign * sines)
            owners.append(which)
        # contacts off sharp edges
        edges = grid.edge_distance(touch.points.reshape(-1, 3))
        if edges is not None:
            slope = edges[1].reshape(touch.points.shape)
            by_twist = np.einsum("bkx,bkxy,bkyn->bkn", slope, touch.by_centre, motion)
            rows.append(by_twist.reshape(-1, by_twist.shape[2]))
            values.append(edges[0] - self.problem.margin)
            owners.append(np.repeat(np.arange(len(pivot)), len(tips.groups)))
        return np.concatenate(rows), np.concatenate(values), np.concatenate(owners)

    # ---- steps ------------------------------------------------------------------------------------------------------
    def advance(self, racers: Sequence[Racer], steps: int, price: float) -> list[Racer]:
        """Return racers after trust-region steps, side by side, each until three in a row gain little.

        Parameters
        ----------
        racers : sequence of Racer
        steps : int
        price : float
            Of violations, mu a metre.
        """
        racers = list(racers)
        for racer in racers:
            racer.radius, racer.idle = max(racer.radius, 2e-3), 0
        for _ in range(steps):
            twists = dict[int, tuple[FloatArray, float]]()
            for i, racer in enumerate(racers):
                if racer.idle < 3 and racer.radius > 1e-4:
                    twist = self._twist(racer, price)
                    if twist is None:
                        racer.radius *= 0.4
                    else:
                        twists[i] = twist
            if not twists:
                break
            moving = [racers[i] for i in twists]
            state = self._moved(moving, np.stack([twist for twist, _ in twists.values()]))
            trials = self.linearise(state, _known([[racer] for racer in moving]))
            rejected = dict[int, Racer]()
            for (i, (_, predicted)), trial in zip(twists.items(), trials, strict=True):
                if self._accepts(racers[i], trial, predicted, price):
                    racers[i] = trial
                else:
                    rejected[i] = trial
            self._learn(racers, rejected)
        return racers

    def _moved(self, racers: Sequence[Racer], twists: FloatArray, corrections: int = 2) -> HandState:
        """Return the postures of racers after twists (b, n), corrected to the second order so that fingertips touch."""
        scale = np.concatenate([np.ones(3), np.full(twists.shape[1] - 3, 1.0 / 0.06)])
        J, pivot = np.stack([racer.touch for racer in racers]) * scale, np.stack([racer.pivot for racer in racers])
        state = self.shapes.moved(HandState.joined([racer.state for racer in racers]), twists, pivot)
        J = J @ self.shapes.free_twists(state.joints, scale)
        pivot = pivot + twists[:, :3]
        for _ in range(corrections):
            gaps = self.touch(self.shapes.links.frames(state), 4).gaps
            forces = np.linalg.solve(J @ J.transpose(0, 2, 1) + 1e-4 * np.eye(J.shape[1]), -gaps[..., None])
            correction = scale * (J.transpose(0, 2, 1) @ forces)[..., 0]
            state, pivot = self.shapes.moved(state, correction, pivot), pivot + correction[:, :3]
        return state

    def _twist(self, racer: Racer, price: float) -> tuple[FloatArray, float] | None:
        """Return the twist that gains most in the linearised program, and its predicted gain; None without one.

        Variables are the twist over the trust region's size, mu over its unit, and the worst gap and worst lack of
        clearance in millimetres.
        """
        n, limits = self.shapes.links.size, self.shapes.limits
        scale = np.full(n, racer.radius / 0.06)
        scale[:3] = racer.radius
        near = racer.values < 4.0 * racer.radius + 1e-3
        # closed linkages allow no motion along their rows, of which some may depend on others
        closed = racer.linkages * scale
        if len(closed):
            _, sizes, closed = np.linalg.svd(closed, full_matrices=False)
            closed = closed[sizes > 1e-6 * sizes[0]]
        parts = [racer.slopes / self.unit, 1e3 * racer.touch, -1e3 * racer.touch, 1e3 * racer.rows[near], closed]
        mu, _, gaps, lacks, end = np.cumsum(list(map(len, parts)))
        A = np.zeros((end, n + 3))
        np.concatenate(parts, out=A[:, :n])
        A[:lacks, :n] *= scale
        A[:mu, n], A[mu:gaps, n + 1], A[gaps:lacks, n + 2] = -1.0, 1.0, 1.0
        room = (limits - racer.state.joints[0]) / scale[6:]
        lower, upper, sense = np.zeros(n + 3 + end), np.zeros(n + 3 + end), np.zeros(n + 3 + end, np.int32)
        lower[:6], upper[:6] = -1.0, 1.0
        lower[6:n], upper[6:n] = np.maximum(np.minimum(room[0], 0.0), -1.0), np.minimum(np.maximum(room[1], 0.0), 1.0)
        lower[n : n + 3], upper[n : n + 3] = (-10.0, 0.0, 0.0), 1e3
        least = [-racer.ratios / self.unit, -1e3 * racer.gaps, 1e3 * racer.gaps, -1e3 * racer.values[near]]
        np.concatenate(least, out=lower[n + 3 : n + 3 + lacks])
        upper[n + 3 : n + 3 + lacks], sense[n + 3 + lacks :] = 1e30, 5  # equations last
        millimetre = 1e-3 * price / self.unit
        H, f = np.zeros((n + 3, n + 3)), np.zeros(n + 3)
        H.flat[:: n + 4], f[n:] = 2e-3, (-1.0, millimetre, millimetre)
        H[n:] *= 5e-5  # 1e-7
        z, _, flag, _ = daqp.solve(H, f, A, upper, lower, sense)
        if flag <= 0:
            return None
        predicted = self.unit * float(z[n] - millimetre * (z[n + 1] + z[n + 2])) - racer.merit(price)
        return z[:n] * scale, predicted

    def _accepts(self, racer: Racer, trial: Racer, predicted: float, price: float) -> bool:
        """Return whether a trial gains enough, and set the trust region of the one that goes on."""
        gain = trial.merit(price) - racer.merit(price)
        if gain > max(0.1 * predicted, 0.0):
            trial.idle = racer.idle + 1 if gain < 1e-3 * self.unit else 0
            factor = 1.6 if gain > 0.6 * predicted else 0.6 if gain < 0.3 * predicted else 1.0
            trial.radius = min(factor * racer.radius, 0.02)
            return True
        racer.radius *= 0.4
        racer.idle += predicted < 3e-4 * self.unit
        return False

    def _learn(self, racers: list[Racer], rejected: dict[int, Racer]) -> None:
        """Add the weak directions of rejected trials, by number, to those of their racers, in place."""
        if not rejected:
            return
        staying = [racers[i] for i in rejected]
        points, normals, moving, turning = (
            np.stack([getattr(racer, name) for racer in staying]) for name in ("points", "normals", "moving", "turning")
        )
        known, G = _known([[racers[i], trial] for i, trial in rejected.items()]), self._stack(points, normals).G
        cuts, ratios = self._distinct(known, GraspBatch(G, self._forces).support(known))
        slopes = self._support_slopes(G, points, normals, moving, turning, cuts)
        for i, racer in enumerate(staying):
            real = np.isfinite(ratios[i])
            racer.cuts, racer.ratios, racer.slopes = cuts[i][real], ratios[i][real], slopes[i][real]
            racer.mu = float(np.min(racer.ratios))


def _known(groups: Sequence[Sequence[Racer]]) -> FloatArray:
    """Return the weak directions of groups of racers, (groups, CUTS, d): of each in turn, repeated where few."""
    result = list[FloatArray]()
    for racers in groups:
        cuts = np.concatenate([racer.cuts[: CUTS // len(racers)] for racer in racers])
        result.append(np.resize(cuts, (CUTS, cuts.shape[1])))
    return np.stack(result)
