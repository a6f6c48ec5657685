"""Sampled workspace of a hand: fingertip and link positions in the palm frame over random joint configurations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandPoints
from nlpgrasp.optimize.surface_samples import IntArray, SampleCloud
from nlpgrasp.problem.problem import GraspProblem

POSTURES = 2048  # sampled joint configurations
SHARES = (0.05, 0.95)  # part of the joint ranges that configurations are drawn from
CELL, EACH = 0.003, 2  # metres, cell size of the grid of fingertip positions; configurations compared per cell
NEAR = 0.004  # metres, largest distance between a cell's centre and a fingertip that counts as in it
INSIDE, PALM_INSIDE = 0.0015, 0.003  # metres, allowed clearance violation of finger links, and of the palm
DISTANCES, AROUND = 32, 0.5  # cells per side of the distance grid; its margin around the body, over the size
ASIDE = np.cos(np.radians(30.0))  # cosine of the largest angle between a flat fingertip's normal and a sample's
NONE = -1  # in place of the number of a configuration: a cell or sample has none
STILL = 1e-9  # metres: smaller motions of a point count as none


@dataclass(frozen=True)
class ReachableSamples:
    """Surface samples reachable by each fingertip from a palm pose.

    Parameters
    ----------
    samples : list of k (m,) int arrays
        Surface samples that each fingertip reaches with its finger's links outside the body, by number.
    postures : list of k int arrays
        The posture that reaches each sample, of all samples.
    """

    samples: list[IntArray]
    postures: list[IntArray]


class HandWorkspace:
    """Random joint configurations with their fingertip and link positions.

    Parameters
    ----------
    problem : GraspProblem
        With a hand that has a pose of its own.
    hand : HandPoints
        Of the problem.
    rows : ConstraintValues
        Of the problem.
    """

    def __init__(self, problem: GraspProblem, hand: HandPoints, rows: ConstraintValues) -> None:
        self._hand, self._tree = hand, hand.posed_hand.tree
        lower, upper = self._tree.joint_limits
        self.joints = lower + np.random.default_rng(0).uniform(*SHARES, (POSTURES, len(lower))) * (upper - lower)
        tips, self._normals = self._tree.palm_tips(self.joints), self._tree.palm_normals(self.joints)
        self._in_cells = [_grid_neighbours(tips[:, i]) for i in range(tips.shape[1])]
        places = self._link_places(self.joints)
        middle = 0.5 * (lower + upper)
        turned = np.concatenate([middle[None], middle + 0.1 * np.diag(upper - lower)])
        self._moves = _differing_points(self._tree.palm_tips(turned))
        links = _differing_points(self._link_places(turned))
        alone = [np.any(links & own, axis=1) & ~np.any(links & ~own, axis=1) for own in self._moves]
        palm = np.flatnonzero(~np.any(links, axis=1))
        least = np.array([rows.named[i].lower for i in rows.clearances])
        self._palm = _Links(places[:1, palm], least[palm])
        self._fingers = [_Links(places[:, own], least[own]) for own in alone]
        body = problem.body
        box = body.bounds + AROUND * body.size * np.array([[-1.0], [1.0]])
        axes = [np.linspace(low, high, DISTANCES) for low, high in box.T]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        distance = np.asarray(body.distance_function.map(len(grid))(grid.T).full())
        self._distance = distance.reshape([DISTANCES] * 3)
        self._corner, self._step = box[0], (box[1] - box[0]) / (DISTANCES - 1)

    def reach(self, palm: FloatArray, samples: list[SampleCloud]) -> ReachableSamples | None:
        """Return the samples reachable from a palm frame (4, 4); None where a fingertip reaches none of its own."""
        R, t = palm[:3, :3], palm[:3, 3]
        if np.min(self._room(self._palm.places, self._palm.least, palm), initial=0.0) < -PALM_INSIDE:
            return None
        found, postures = [], []
        for i, (cloud, radius) in enumerate(zip(samples, self._hand.hand.tip_radii, strict=True)):
            corner, cells = self._in_cells[i]
            where = ((cloud.points - radius * cloud.normals - t) @ R - corner) / CELL
            inside = np.all((where >= 0.0) & (where < cells.shape[:3]), axis=1)
            posture = np.full((len(where), EACH), NONE)
            posture[inside] = cells[tuple(where[inside].astype(int).T)]
            near, links = np.nonzero(posture != NONE), self._fingers[i]
            room = np.full(posture.shape, -np.inf)
            room[near] = np.min(self._room(links.places[posture[near]], links.least, palm), axis=1, initial=0.0)
            facing = np.sum(self._normals[posture[near], i] * (cloud.normals @ R)[near[0]], axis=1)
            room[near] = np.where((facing < ASIDE) & self._normals[0, i].any(), -np.inf, room[near])
            roomiest = np.argmax(room, axis=1)
            found.append(np.flatnonzero(np.max(room, axis=1) >= -INSIDE))
            postures.append(posture[np.arange(len(posture)), roomiest])
        return ReachableSamples(found, postures) if all(map(len, found)) else None

    def joints_at(self, reach: ReachableSamples, samples: IntArray, otherwise: FloatArray) -> FloatArray:
        """Return joints (m,) that bring the fingertips next to samples (k,), from the stored configurations.

        A joint that moves several fingertips goes to the mean of what these ask for; one that moves none stays.
        """
        asked = np.stack([self.joints[postures[one]] for postures, one in zip(reach.postures, samples, strict=True)])
        count = np.sum(self._moves, axis=0)
        return np.where(count > 0, np.sum(asked * self._moves, axis=0) / np.maximum(count, 1), otherwise)

    def _room(self, places: FloatArray, least: FloatArray, palm: FloatArray) -> FloatArray:
        """Return the clearance of link spheres at centres (b, s, 3) beyond what they need from the body, (b, s)."""
        from scipy.ndimage import map_coordinates  # slow to import, for hands alone

        where = (places @ palm[:3, :3].T + palm[:3, 3] - self._corner) / self._step
        distance = map_coordinates(self._distance, np.moveaxis(where, -1, 0), order=1, cval=np.inf)
        return np.asarray(distance - least)

    def _link_places(self, joints: FloatArray) -> FloatArray:
        """Return the centres of the link spheres in the palm frame, (b, s, 3), for joints (b, m)."""
        count = len(joints)
        palm = {"palm_position": np.zeros((count, 3)), "palm_quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))}
        return self._hand.link_places(palm | {"joints": joints} | self._tree.initial_slides(count))


class _Links:
    """Spheres around links of the palm or of one finger: centres (b, s, 3), palm frame, and least distances."""

    def __init__(self, places: FloatArray, least: FloatArray) -> None:
        self.places, self.least = np.ascontiguousarray(places), least


def _differing_points(places: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of points (s, 3) that differ from those of the first of (1 + m) configurations, (s, m)."""
    return np.asarray(np.linalg.norm(places[1:] - places[:1], axis=2) > STILL).T


def _grid_neighbours(tips: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the corner (3,) of a grid over points (b, 3), and the nearest few points of each cell, by number."""
    corner = tips.min(axis=0) - NEAR
    count = np.ceil((tips.max(axis=0) + NEAR - corner) / CELL).astype(int)
    middles = corner + CELL * (np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1) + 0.5)
    apart, nearest = cKDTree(tips).query(middles, EACH, distance_upper_bound=NEAR)
    return corner, np.where(np.isfinite(apart), nearest, NONE)
