"""Local search of a hand's contacts over mesh samples, from their projections of the smooth surface.

Smoothing rounds edges and noise; where the smooth surface and the mesh differ, the nearest point of the mesh
may have quite another normal. So the nearest points are only the beginning: the contacts then slide over the
mesh, one at a time, to the sample point that exerts the task best. They stay where the mesh's normal is within
30 degrees of the smooth one: nobody can rely on a finger on a sharp edge or on one noisy triangle.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solve.surface.scored import Scored
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.surface_samples import plain
from nlpgrasp.solve.workbench.workbench import Workbench

FIRST_REACH, LAST_REACH = 0.12, 0.01  # over the body's size: largest move of a contact, at first and at last
TRIALS = 48  # mesh points tried per move
SWEEPS = 12  # sweeps over all contacts, at most
GAIN = 1e-3  # relative: a sweep that gains less is undone


def slide_onto_mesh(
    bench: Workbench,
    start: Placed,
    rng: np.random.Generator,
    stop: Stop,
    reach: float = FIRST_REACH,
) -> Grasp:
    """Return a grasp with its contacts on the mesh and the mesh's own normals, after a local search.

    Every move is to a point of the mesh, and raises the least ratio over the weakest directions found so far; these are
    searched anew after each sweep.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh.
    start : Placed
        Contacts on the smooth surface, and the hand.
    rng : numpy.random.Generator
    stop : Stop
    reach : float
        How far a contact may slide in the first moves, over the body's size.
    """
    sliding = _Sliding(bench, start, rng)
    best, best_value = sliding.contacts(), sliding.value()
    for _ in range(SWEEPS):
        if stop.requested() or reach < LAST_REACH:
            break
        moved = sliding.sweep(reach * bench.scaling.length)
        sliding.look()
        value = sliding.value()
        if value > best_value * (1.0 + GAIN):
            best, best_value = sliding.contacts(), value
        else:
            sliding.points, sliding.normals = (v.copy() for v in best)
            moved = False
        if not moved:
            reach *= 0.5
    return bench.grasp_at(*best)


class _Sliding:
    """State of sliding contacts on a mesh, with their weak directions."""

    def __init__(self, bench: Workbench, start: Placed, rng: np.random.Generator) -> None:
        self.bench, self.rng = bench, rng
        self.points, self.normals = _nearest_plain(bench, start.points)
        self._scored = Scored(bench, rng)
        self.look()

    def contacts(self) -> tuple[FloatArray, FloatArray]:
        """Return the current points and inward normals."""
        return self.points.copy(), self.normals.copy()

    def look(self) -> None:
        """Add the weak directions of the current contacts."""
        self._scored.look(self.points, self.normals)

    def value(self) -> float:
        """Return the least ratio over all known directions, with a tie-break for placements without force closure."""
        return float(self._scored.of(self.points[None], self.normals[None])[0])

    def sweep(self, reach: float) -> bool:
        """Move each contact to its best mesh point within reach, metres; return whether any moved."""
        moved = False
        for i in range(len(self.points)):
            moved |= self._move(i, reach)
        return moved

    def _move(self, i: int, reach: float) -> bool:
        """Move contact i to the best nearby mesh point if that improves the grasp; return whether it moved."""
        cloud = self.bench.surface.mesh_cloud
        near = np.array(cloud.tree.query_ball_point(self.points[i], reach), dtype=int)
        if not near.size:
            return False
        if near.size > TRIALS:
            near = self.rng.choice(near, TRIALS, replace=False)
        points, normals = (np.repeat(v[None], near.size + 1, axis=0) for v in (self.points, self.normals))
        points[1:, i], normals[1:, i] = cloud.points[near], cloud.normals[near]
        score = self._scored.of(points, normals)
        best = int(np.argmax(score))
        self.points, self.normals = points[best].copy(), normals[best].copy()
        return best != 0


def _nearest_plain(bench: Workbench, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest mesh points away from sharp edges, and the mesh's inward normals there."""
    body, cloud = bench.surface.mesh, bench.surface.mesh_cloud
    positions, outward, _ = body.closest(points)
    kept = plain(bench.problem, positions, outward)[:, None]
    nearest = cloud.tree.query(points)[1]
    return np.where(kept, positions, cloud.points[nearest]), np.where(kept, -outward, cloud.normals[nearest])
