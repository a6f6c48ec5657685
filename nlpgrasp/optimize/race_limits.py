"""Limits on raced postures that a problem states: its constraints, the solids around the body, the faces of contacts.

Constraints are the program's functions of contacts, normals and the hand's variables; their derivatives by the twist
follow by the chain rule. What they keep links away from is a solid with a distance, as the body is. No kind of
constraint is named here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.distance_grid import DistanceGrid
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.spatial import cross_matrix
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.moving_links import Frames, HandState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.hand_shapes import HandShapes
from nlpgrasp.optimize.surface_samples import SampleCloud

NOTHING = 1e-9  # slope by the twist below which a constraint does not depend on it


@dataclass(frozen=True)
class PosedContacts:
    """Postures of a hand with their contacts, b at a time, and the derivatives of these by the twist.

    Parameters
    ----------
    state : HandState
    points, normals : (b, k, 3) arrays
        Contacts, metres, and inward unit normals.
    points_by_twist, normals_by_twist : (b, k, 3, 6 + m) arrays
    pivot : (b, 3) array
        Of the twist.
    """

    state: HandState
    points: FloatArray
    normals: FloatArray
    points_by_twist: FloatArray
    normals_by_twist: FloatArray
    pivot: FloatArray

    @classmethod
    def nearest(cls, shapes: HandShapes, grid: DistanceGrid, state: HandState, frames: Frames) -> PosedContacts:
        """Return postures with contacts at the body's points nearest to the fingertips, by the grid of distances."""
        tips = shapes.tips
        centres = frames.points(tips.at, tips.groups)
        distances, slopes = (part.reshape(*centres.shape[:2], -1) for part in grid.distance(centres.reshape(-1, 3)))
        normals = -slopes / np.maximum(np.linalg.norm(slopes, axis=2, keepdims=True), NOTHING)
        pivot = centres.mean(axis=1)
        motion = frames.motions(centres, tips.groups, pivot)
        across = np.einsum("bkx,bkxn->bkn", normals, motion)
        along = motion - normals[..., None] * across[:, :, None]
        return cls(state, centres + distances * normals, normals, along, np.zeros_like(motion), pivot)


class RaceLimits:
    """Evaluator of the limits of a problem: what must not be negative, in lengths, with derivatives by the twist.

    A contact that is kept to some faces, or off edges, has to be near a sample of its faces and have about its normal:
    the smooth surface rounds the edges between faces, those of a machined part's mesh as well. A constraint's value is
    divided by its slope along the unit of motion, a metre or the turn that moves a point at 60 mm by it, in the median
    of some postures, so that it counts as a length whatever its unit.

    Parameters
    ----------
    compiled : CompiledProblem
    least_cosine : float
        Between a contact's normal and that of the nearest sample.
    """

    def __init__(self, compiled: CompiledProblem, least_cosine: float = 0.985) -> None:
        rows, problem = compiled.rows, compiled.problem
        self._slides = compiled.hand_functions.linked_hand.tree.initial_slides
        users = [i for source in rows.sources[: len(problem.constraints)] for i in source]
        self._rows, self._indices = rows, users
        self._lower, self._upper = (
            np.array([getattr(rows.named[i], end) for i in users]) for end in ("lower", "upper")
        )
        self._units = np.zeros(0)  # of the constraints, from the first postures
        self._least_cosine = least_cosine
        every = problem.body.face_names
        is_flat = isinstance(problem.body, Mesh) and problem.body.has_flat_faces
        has_edges = is_flat or (len(every) > 1 and problem.margin > 0.0)
        kept = [i for i in range(len(problem.models)) if has_edges or problem.allowed_faces(i) != every]
        self._clouds: dict[int, SampleCloud] = {i: compiled.surface.cloud(i) for i in kept}
        self._gaps = {i: _spacing(cloud) for i, cloud in self._clouds.items()}

    def __bool__(self) -> bool:
        return bool(self._indices or self._clouds)

    @cached_property
    def _evaluator(self) -> BatchEvaluator:
        return self._rows.linearised(self._indices)

    def lacks(self, contacts: PosedContacts) -> FloatArray:
        """Return the summed violations of each posture, (b,), metres."""
        which, values, _ = self.rows(contacts)
        return np.asarray(np.bincount(which, np.maximum(-values, 0.0), len(contacts.points)), dtype=float)

    def rows(self, contacts: PosedContacts) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return postures (n,), values (n,), metres, and derivatives by the twist (n, 6 + m) of all limits."""
        count, size = len(contacts.points), contacts.points_by_twist.shape[3]
        which, values, slopes = [np.zeros(0, int)], [np.zeros(0)], [np.zeros((0, size))]
        if self._indices:
            found, by_twist = self._user_rows(contacts)
            for sign, limit in ((1.0, self._lower), (-1.0, self._upper)):
                limited = np.isfinite(limit)
                value = sign * (found[:, limited] - limit[limited]) / self._units[limited]
                slope = sign * by_twist[:, limited] / self._units[limited][:, None]
                which.append(np.repeat(np.arange(count), value.shape[1]))
                values.append(value.ravel())
                slopes.append(slope.reshape(-1, size))
        for i, cloud in self._clouds.items():  # distance from the nearest sample of the contact's faces
            nearest = np.asarray(cloud.tree.query(contacts.points[:, i])[1])
            distance = np.linalg.norm(contacts.points[:, i] - cloud.points[nearest], axis=1)
            away = (contacts.points[:, i] - cloud.points[nearest]) / np.maximum(distance, 1e-9)[:, None]
            which.append(np.arange(count))
            values.append(self._gaps[i] - distance)
            slopes.append(-np.einsum("bx,bxn->bn", away, contacts.points_by_twist[:, i]))
            which.append(np.arange(count))
            values.append(0.01 * (np.sum(contacts.normals[:, i] * cloud.normals[nearest], axis=1) - self._least_cosine))
            slopes.append(0.01 * np.einsum("bx,bxn->bn", cloud.normals[nearest], contacts.normals_by_twist[:, i]))
        return np.concatenate(which), np.concatenate(values), np.concatenate(slopes)

    def _user_rows(self, contacts: PosedContacts) -> tuple[FloatArray, FloatArray]:
        """Return the values (b, r) of the user's constraints, in their units, and their derivatives (b, r, 6 + m)."""
        state, count = contacts.state, len(contacts.points)
        hand = state.values | self._slides(count)
        flat = contacts.points.reshape(count, -1), contacts.normals.reshape(count, -1)
        values, by_inputs = self._evaluator(*flat, *hand.values())
        size, width = contacts.points_by_twist.shape[3], sum(part.shape[1] for part in (*flat, *hand.values()))
        inputs = np.zeros((count, width, size))
        end = 2 * flat[0].shape[1]
        inputs[:, : end // 2] = contacts.points_by_twist.reshape(count, -1, size)
        inputs[:, end // 2 : end] = contacts.normals_by_twist.reshape(count, -1, size)
        inputs[:, end : end + 3, :3] = np.eye(3)
        inputs[:, end : end + 3, 3:6] = cross_matrix(contacts.pivot - state.position)
        w, v = hand["palm_quaternion"][:, 0], hand["palm_quaternion"][:, 1:]
        inputs[:, end + 3, 3:6] = -0.5 * v  # of the quaternion: half the product of a turn and itself
        inputs[:, end + 4 : end + 7, 3:6] = 0.5 * (w[:, None, None] * np.eye(3) - cross_matrix(v))
        inputs[:, end + 7 : end + 1 + size, 6:] = np.eye(size - 6)
        by_twist = by_inputs.reshape(count, -1, width) @ inputs
        if not len(self._units):
            scaled = by_twist * np.concatenate([np.ones(3), np.full(size - 3, 1.0 / 0.06)])
            self._units = np.maximum(np.median(np.max(np.abs(scaled), axis=2), axis=0), NOTHING)
        return values.reshape(count, -1), by_twist


def _spacing(cloud: SampleCloud) -> float:
    """Return the distance, metres, within which nearly every point of a cloud has another."""
    return float(np.quantile(np.asarray(cloud.tree.query(cloud.points, 2)[0])[:, 1], 0.98))
