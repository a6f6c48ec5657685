"""Neighbours of known grasps: one contact moved elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.optimize.start.random_placements import Drawn
from nlpgrasp.optimize.start.scores import scores
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.quality.screening import screen

KNOWN = 12  # best grasps whose neighbours are computed
PLACES = 48  # positions tried per contact
SCREENED = 4  # placements screened closely per grasp wanted


def neighbours(bench: Workbench, known: Sequence[Placed], count: int) -> list[Placed]:
    """Return up to ``count`` grasps that differ from a known one in one contact, the best first.

    They keep the constraints, and exert the task as far as an upper bound on their mu tells. For problems whose hand,
    if any, follows from the contacts.

    Parameters
    ----------
    bench : Workbench
    known : sequence of Placed
        The best first.
    count : int
    """
    drawn = [_moved(bench, placed) for placed in known[:KNOWN]]
    points = np.concatenate([moved.points for moved in drawn])
    normals = np.concatenate([moved.normals for moved in drawn])
    faces = np.concatenate([moved.faces for moved in drawn])
    hand = bench.hand_points.start(points, normals)
    allowed = np.flatnonzero(bench.rows.violations(points, normals, hand) <= FEASIBLE)
    if not len(allowed):
        return []
    worth = scores(bench, points[allowed], normals[allowed])
    best = allowed[np.argsort(-worth, kind="stable")[: SCREENED * count]]
    stack = GraspStack(points[best], normals[best], bench.problem.models, bench.problem.origin)
    bound = screen(stack, bench.problem.task, force_budget=bench.screening_budget)
    order = [int(i) for i in np.argsort(-bound, kind="stable") if bound[i] > 0.0]
    chosen = best[order[:count]]
    return [Placed(tuple(faces[i]), points[i], {name: v[i] for name, v in hand.items()}) for i in chosen]


def _moved(bench: Workbench, placed: Placed) -> Drawn:
    """Return a grasp with each contact in turn at points spread over the faces that it may use."""
    k, count = len(placed.faces), PLACES * len(placed.faces)
    points, normals = (np.stack([a] * count) for a in (placed.points, bench.inward_normals(placed)))
    faces = np.empty((count, k), dtype=object)
    faces[:] = placed.faces
    for i in range(k):
        cloud, rows = bench.surface.cloud(i), slice(i * PLACES, (i + 1) * PLACES)
        where = np.linspace(0, len(cloud.points) - 1, PLACES).astype(int)
        points[rows, i], normals[rows, i], faces[rows, i] = (
            cloud.points[where],
            cloud.normals[where],
            cloud.faces[where],
        )
    return Drawn(points, normals, faces)
