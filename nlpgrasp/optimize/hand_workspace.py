"""Sampled workspace of a hand: fingertip and link positions in the palm frame over random joint configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandFunctions
from nlpgrasp.optimize.surface_samples import SampleCloud
from nlpgrasp.problem.problem import GraspProblem

POSTURES = 2048  # sampled joint configurations
SHARES = (0.05, 0.95)  # lower and upper end of the sampled part of each joint range
CELL, PER_CELL = 0.003, 2  # metres, cell size of the grid of fingertip positions; configurations per cell
NEAR = 0.004  # metres, largest distance of a fingertip from the centre of its cell
INSIDE, PALM_INSIDE = 0.0015, 0.003  # metres, allowed clearance violation of finger links, and of the palm
DISTANCES, MARGIN = 32, 0.5  # points per side of the distance grid; its margin around the body, over the size
ALIGNED = np.cos(np.radians(30.0))  # cosine of the largest angle between the normals of a flat fingertip and a sample
NONE = -1  # index where a cell or sample has no configuration
FIXED = 1e-9  # metres: smaller motions of a point count as none


@dataclass(frozen=True)
class ReachableSamples:
    """Surface samples reachable by each fingertip from a palm pose.

    Parameters
    ----------
    samples : sequence of k (m,) int arrays
        Indices of the surface samples that each fingertip reaches with its finger's links outside the body.
    postures : sequence of k int arrays
        Index of a joint configuration that reaches each of all samples.
    """

    samples: Sequence[IntArray]
    postures: Sequence[IntArray]


class HandWorkspace:
    """Sampled workspace of a hand: random joint configurations with fingertip and link positions.

    Parameters
    ----------
    problem : GraspProblem
        Problem with a hand that has a pose of its own.
    hand : HandFunctions
    rows : ConstraintValues
    """

    def __init__(self, problem: GraspProblem, hand: HandFunctions, rows: ConstraintValues) -> None:
        self._hand, self._tree = hand, hand.posed_hand.tree
        lower, upper = self._tree.joint_limits
        self.joints = self._tree.random_joints(POSTURES, np.random.default_rng(0), SHARES)
        tips, self._normals = self._tree.palm_tips(self.joints), self._tree.palm_normals(self.joints)
        self._in_cells = [_grid_neighbours(tips[:, i]) for i in range(tips.shape[1])]
        middle = 0.5 * (lower + upper)
        displaced = np.concatenate([middle[None], middle + 0.1 * np.diag(upper - lower)])  # one joint at a time
        self._moves = _differing_points(self._tree.palm_tips(displaced))
        links = _differing_points(self._link_centres(displaced))
        of_finger = [np.any(links & joints, axis=1) & ~np.any(links & ~joints, axis=1) for joints in self._moves]
        of_palm = np.flatnonzero(~np.any(links, axis=1))
        centres = self._link_centres(self.joints)
        least = np.array([rows.named[i].lower for i in rows.clearances])
        self._palm = _Links(centres[:1, of_palm], least[of_palm])
        self._fingers = [_Links(centres[:, links], least[links]) for links in of_finger]
        body = problem.body
        box = body.bounds + MARGIN * body.size * np.array([[-1.0], [1.0]])
        axes = [np.linspace(low, high, DISTANCES) for low, high in box.T]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self._distance = body.distances(grid)[0].reshape([DISTANCES] * 3)
        self._corner, self._step = box[0], (box[1] - box[0]) / (DISTANCES - 1)

    def reach(self, palm: FloatArray, samples: list[SampleCloud]) -> ReachableSamples | None:
        """Return the samples that each fingertip reaches from a palm frame (4, 4); None if one reaches none.

        None as well where the palm penetrates the body.
        """
        R, t = palm[:3, :3], palm[:3, 3]
        if np.min(self._clearance(self._palm, self._palm.centres, palm), initial=0.0) < -PALM_INSIDE:
            return None
        reachable, postures = [], []
        for i, (cloud, radius) in enumerate(zip(samples, self._hand.posed_hand.posing_radii, strict=True)):
            corner, cells = self._in_cells[i]
            position = ((cloud.points - radius * cloud.normals - t) @ R - corner) / CELL
            inside = np.all((position >= 0.0) & (position < cells.shape[:3]), axis=1)
            posture = np.full((len(position), PER_CELL), NONE)
            posture[inside] = cells[tuple(position[inside].astype(int).T)]
            candidates, links = np.nonzero(posture != NONE), self._fingers[i]
            clearance = np.full(posture.shape, -np.inf)
            clearance[candidates] = np.min(
                self._clearance(links, links.centres[posture[candidates]], palm), axis=1, initial=0.0
            )
            alignment = np.sum(self._normals[posture[candidates], i] * (cloud.normals @ R)[candidates[0]], axis=1)
            clearance[candidates] = np.where(
                (alignment < ALIGNED) & self._normals[0, i].any(), -np.inf, clearance[candidates]
            )
            largest = np.argmax(clearance, axis=1)
            reachable.append(np.flatnonzero(np.max(clearance, axis=1) >= -INSIDE))
            postures.append(posture[np.arange(len(posture)), largest])
        return ReachableSamples(reachable, postures) if all(map(len, reachable)) else None

    def joints_at(self, reach: ReachableSamples, samples: IntArray, otherwise: FloatArray) -> FloatArray:
        """Return joint values (m,) that bring the fingertips close to samples (k,).

        A joint that moves several fingertips has the mean of the values stored for them; one that moves none has
        ``otherwise``.
        """
        by_finger = np.stack(
            [self.joints[postures[sample]] for postures, sample in zip(reach.postures, samples, strict=True)]
        )
        count = np.sum(self._moves, axis=0)
        mean = np.where(count > 0, np.sum(by_finger * self._moves, axis=0) / np.maximum(count, 1), otherwise)
        return self._tree.close(mean)

    def _clearance(self, links: _Links, centres: FloatArray, palm: FloatArray) -> FloatArray:
        """Return the distance of link spheres at centres (b, s, 3) from the body, less the required one, (b, s)."""
        from scipy.ndimage import map_coordinates  # slow to import, for hands alone

        position = (centres @ palm[:3, :3].T + palm[:3, 3] - self._corner) / self._step
        distance = map_coordinates(self._distance, np.moveaxis(position, -1, 0), order=1, cval=np.inf)
        return np.asarray(distance - links.least)

    def _link_centres(self, joints: FloatArray) -> FloatArray:
        """Return the centres of the link spheres in the palm frame, (b, s, 3), for joints (b, m)."""
        count = len(joints)
        palm = {"palm_position": np.zeros((count, 3)), "palm_quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))}
        return self._hand.link_sphere_centres(palm | {"joints": joints} | self._tree.initial_slides(count))


class _Links:
    """Spheres around links of the palm or of one finger, with their required distances from the body.

    Centres are (b, s, 3), in the palm frame; least distances (s,).
    """

    def __init__(self, centres: FloatArray, least: FloatArray) -> None:
        self.centres, self.least = np.ascontiguousarray(centres), least


def _differing_points(points: FloatArray) -> BoolArray:
    """Return the mask (s, m) of the points that move between the first and each later configuration.

    Points are (1 + m, s, 3), those of the first configuration first.
    """
    return np.asarray(np.linalg.norm(points[1:] - points[:1], axis=2) > FIXED).T


def _grid_neighbours(tips: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the corner (3,) of a grid over points (b, 3), and the indices of up to ``PER_CELL`` points for each cell.

    They are the points nearest to the cell's centre within ``NEAR``, padded with ``NONE``. Each point is compared with
    the cells around it, which are far fewer than all cells.
    """
    corner = tips.min(axis=0) - NEAR
    shape = np.ceil((tips.max(axis=0) + NEAR - corner) / CELL).astype(int)
    reach = int(np.ceil(NEAR / CELL + 0.5))
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = ((tips - corner) / CELL).astype(int)[:, None] + offsets
    distances = np.linalg.norm(corner + CELL * (cells + 0.5) - tips[:, None], axis=2)
    is_near = (distances < NEAR) & np.all((cells >= 0) & (cells < shape), axis=2)
    point, cell = np.nonzero(is_near)[0], np.ravel_multi_index(tuple(cells[is_near].T), shape)
    order = np.lexsort((distances[is_near], cell))
    point, cell = point[order], cell[order]
    rank = np.arange(len(cell)) - np.searchsorted(cell, cell)  # of a point among those near its cell
    is_kept = rank < PER_CELL
    nearest = np.full((int(np.prod(shape)), PER_CELL), NONE)
    nearest[cell[is_kept], rank[is_kept]] = point[is_kept]
    return corner, nearest.reshape(*shape, PER_CELL)
