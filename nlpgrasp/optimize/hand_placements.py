"""Placements of a hand's postures about a body: drawn by thousands, screened, and moved into contact, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, permutations

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.distance_grid import DistanceGrid
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.moving_links import HandState, LinkPoints, turned
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import CoordinateExchange
from nlpgrasp.optimize.hand_postures import Postures
from nlpgrasp.optimize.race_limits import PosedContacts
from nlpgrasp.optimize.race_steps import RaceSteps


@dataclass(frozen=True)
class BodyPlaces:
    """Points of a body's surface with outward normals, and the body's thickness below them.

    Parameters
    ----------
    points, normals : (n, 3) arrays
    thickness : (n,) array
        Metres, along the normal.
    centroid : (3,) array
    sides : (3,) array
        Of the bounding box, metres.
    """

    points: FloatArray
    normals: FloatArray
    thickness: FloatArray
    centroid: FloatArray
    sides: FloatArray

    @classmethod
    def of(cls, body: Body, grid: DistanceGrid, points: FloatArray, normals: FloatArray) -> BodyPlaces:
        """Return the places at points of a body's surface, (n, 3), with outward normals."""
        sides = np.ptp(body.bounds, axis=0)
        steps = np.linspace(2.0 * grid.spacing, 1.2 * float(np.max(sides)), 150)
        is_out = grid.nearest(points[:, None] - steps[:, None] * normals[:, None]) > 0.0
        thickness = np.where(is_out.any(axis=1), steps[np.argmax(is_out, axis=1)], steps[-1])
        return cls(points, normals, thickness, np.asarray(body.centroid), sides)


def placements(
    compiled: CompiledProblem, library: dict[str, Postures], places: BodyPlaces, steps: RaceSteps, count: int,
    keep: int, rng: np.random.Generator,
) -> list[HandState]:  # fmt: skip
    """Return ``keep`` postures of each kind nearly in contact with the body, of ``count`` drawn ones in all."""
    kinds = [_around(library["ball"], places, count // 2, rng), _across(library["slab"], places, count // 2, rng)]
    # where limits or two contacts leave few placements, or no posture fits the body
    if steps.limits or compiled.hand_functions.linked_hand.count == 2 or not any(map(len, kinds)):
        kinds.append(_onto_free_grasps(compiled, rng))
    return [_screened(steps, state, keep) for state in kinds]


def _onto_free_grasps(compiled: CompiledProblem, rng: np.random.Generator, most: int = 40) -> HandState:
    """Return postures whose fingertips are near the contacts of good grasps without a hand, ``most`` for each."""
    free, hand = compiled.handless_variant, compiled.hand_functions.linked_hand
    search = CoordinateExchange(free, free.sample_tables, rng)
    points, normals = free.sample_tables.contacts_of(search.exchange(search.draw()))
    interchangeable = len(set(free.sample_tables.of_contact)) == 1
    orders = np.array(list(islice(permutations(range(hand.count)), 24 if interchangeable else 1)))
    near = max(4, 2 * most // len(orders))
    targets = points[:, orders] - np.asarray(hand.posing_radii)[:, None] * normals[:, orders]
    values, tips = hand.reach(targets.reshape(-1, *points.shape[1:]), near, rng)
    misses = np.linalg.norm(tips - np.repeat(targets.reshape(-1, *points.shape[1:]), near, axis=0), axis=2).sum(axis=1)
    first = np.argsort(misses.reshape(len(points), -1), axis=1, kind="stable")[:, :most]
    chosen = (first + len(orders) * near * np.arange(len(points))[:, None]).ravel()
    turns = Rotation.from_quat(values["palm_quaternion"][chosen], scalar_first=True).as_matrix()
    return HandState(turns, values["palm_position"][chosen], values["joints"][chosen])


def _around(postures: Postures, places: BodyPlaces, count: int, rng: np.random.Generator) -> HandState:
    """Return postures turned at random with the middle of their balls in the body."""
    fits = (postures.radii > 0.2 * places.sides.min()) & (postures.radii < 0.65 * places.sides.max())
    weights = np.maximum(postures.scores, 0.02) ** 2 * fits
    if not weights.sum():
        return HandState(np.zeros((0, 3, 3)), np.zeros((0, 3)), postures.joints[:0])
    chosen = rng.choice(len(weights), count, p=weights / weights.sum())
    turns = Rotation.random(count, rng=rng).as_matrix()
    middles = places.centroid + rng.uniform(-0.3, 0.3, (count, 3)) * places.sides
    return HandState(turns, middles - turned(turns, postures.middles[chosen]), postures.joints[chosen])


def _across(postures: Postures, places: BodyPlaces, count: int, rng: np.random.Generator) -> HandState:
    """Return postures of two opposed groups of fingertips across the body's thickness at random places."""
    order = np.argsort(postures.radii)
    place = rng.integers(0, len(places.points), count)
    half = places.thickness[place] / 2.0
    low, high = (np.searchsorted(postures.radii[order], half + d) for d in (-4e-3, 4e-3))
    fits = high > low
    place, half, low, high = place[fits], half[fits], low[fits], high[fits]
    if not len(place):
        return HandState(np.zeros((0, 3, 3)), np.zeros((0, 3)), postures.joints[:0])
    tried = order[low + (rng.random((3, len(place))) * (high - low)).astype(int)]
    chosen = tried[np.argmax(postures.scores[tried], axis=0), np.arange(len(place))]
    normals = places.normals[place]
    turns = _onto(postures.axes[chosen], rng.choice([-1.0, 1.0], len(place))[:, None] * normals)
    turns = Rotation.from_rotvec(normals * rng.uniform(-np.pi, np.pi, (len(place), 1))).as_matrix() @ turns
    middles = places.points[place] - half[:, None] * normals
    aside = places.centroid + rng.uniform(-0.25, 0.25, (len(place), 3)) * places.sides - middles
    aside -= np.sum(aside * normals, axis=1, keepdims=True) * normals
    middles = middles + aside * rng.choice([0.5, 1.0], (len(place), 1))
    return HandState(turns, middles - turned(turns, postures.middles[chosen]), postures.joints[chosen])


def _onto(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return rotations (b, 3, 3) that take unit vectors (b, 3) to others."""
    axes, cosines = np.cross(first, second), np.sum(first * second, axis=1)
    sines = np.linalg.norm(axes, axis=1)
    beside = np.cross(first, np.eye(3)[np.argmin(np.abs(first), axis=1)])
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    axes = np.where(sines[:, None] > 1e-6, axes / np.maximum(sines, 1e-9)[:, None], beside)
    return np.asarray(Rotation.from_rotvec(axes * np.arctan2(sines, cosines)[:, None]).as_matrix())


def _screened(steps: RaceSteps, state: HandState, keep: int) -> HandState:
    """Return the postures with the least gaps of fingertips, depths of links and violations of limits.

    By few samples of the links, then by more.
    """
    shapes, grid, solids, limits = steps.shapes, steps.grid, steps.solids, steps.limits
    for stride, kept in ((200, 4 * keep), (24, keep)):
        few = LinkPoints(shapes.samples.at[::stride], shapes.samples.groups[::stride])
        scores = list[FloatArray]()
        for start in range(0, len(state), 128):  # few postures at a time need little memory
            part = state.of(slice(start, start + 128))
            frames = shapes.links.frames(part)
            depths = np.minimum(solids.nearest(frames.cloud(few)), 0.0)
            gaps = np.abs(grid.nearest(steps.ball_centres(frames)) - shapes.tips.radii)
            spread = np.sqrt(150.0 / max(len(few.at), 1))  # as for 150 samples
            scores.append(gaps.sum(axis=1) + spread * np.sqrt(np.sum(depths**2, axis=1)))
            if limits:
                scores[-1] += limits.lacks(PosedContacts.nearest(shapes, grid, part, frames))
        state = state.of(np.argsort(np.concatenate([np.zeros(0), *scores]), kind="stable")[:kept])
    return state


def in_contact(
    race: RaceSteps, state: HandState, steps: int = 8, clearance: float = 1e-3, worst: int = 10
) -> HandState:
    """Return the postures after damped Gauss-Newton steps: fingertips touch, the ``worst`` samples get outside."""
    shapes, grid, solids = race.shapes, race.grid, race.solids
    few = LinkPoints(shapes.samples.at[::16], shapes.samples.groups[::16])
    tips, count = shapes.tips, len(state)
    scale = np.concatenate([np.full(3, 0.02), np.full(3, 0.25), np.full(shapes.links.size - 6, 0.3)])
    for _ in range(steps):
        frames = shapes.links.frames(state)
        centres, cloud = race.ball_centres(frames), frames.cloud(few)
        deepest = np.argpartition(solids.nearest(cloud), worst, axis=1)[:, :worst]
        lowest = np.take_along_axis(cloud, deepest[..., None], axis=1)
        points = np.concatenate([centres, lowest], axis=1)
        groups = np.concatenate([np.broadcast_to(tips.groups, centres.shape[:2]), few.groups[deepest]], axis=1)
        parts = [grid.distance(centres.reshape(-1, 3)), solids.distance(lowest.reshape(-1, 3))]
        values, slopes = (
            np.concatenate([p.reshape(count, -1, *p.shape[1:]) for p in pair], axis=1)
            for pair in zip(*parts, strict=True)
        )
        which = np.repeat(np.arange(count), points.shape[1])
        pivot = centres.mean(axis=1)
        J = scale * frames.rows(points.reshape(-1, 3), groups.ravel(), slopes.reshape(-1, 3), pivot, which)
        J = J.reshape(count, -1, len(scale)) @ shapes.free_twists(state.joints, scale)
        touch = values[:, : len(tips.radii)] - tips.radii
        lack = np.minimum(values[:, len(tips.radii) :] - clearance, 0.0)
        weight = np.concatenate([np.ones_like(touch), 0.7 * (lack < 0.0)], axis=1)
        r, J = weight * np.concatenate([touch, lack], axis=1), weight[..., None] * J
        A = J @ J.transpose(0, 2, 1) + 2e-6 * np.eye(J.shape[1])
        z = (J.transpose(0, 2, 1) @ np.linalg.solve(A, -r[..., None]))[..., 0]
        z /= np.maximum(1.0, np.max(np.abs(z), axis=1, keepdims=True))
        state = shapes.moved(state, z * scale, pivot)
    return state
