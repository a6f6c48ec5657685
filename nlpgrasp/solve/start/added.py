"""A grasp of a problem from one with other contacts: some are added where they help most, or all are taken over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.wider import placed_in
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solve.start.given import Given
from nlpgrasp.solve.start.scores import scores
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

DRAWN = 128  # places of added contacts that are looked at


def with_more(bench: Workbench, grasp: Grasp, faces: Sequence[str]) -> Given | None:
    """Return a grasp of the workbench's problem, in which each contact of a smaller grasp has a wider one's place.

    Contacts that are left are put where, of some places drawn, the constraints are kept and the task is exerted best.
    None where the contacts are not wider, or where no place drawn keeps the constraints. For problems whose hand, if
    any, follows from the contacts.

    Parameters
    ----------
    bench : Workbench
    grasp : Grasp
        With j <= k contacts, on the same body.
    faces : sequence of j str
        The face each is on.
    """
    models, space = bench.problem.models, grasp.space
    places = placed_in(grasp.contacts, models, space)
    if places is None:
        return None
    k = len(models)
    rng, count = np.random.default_rng(k), DRAWN if k > len(grasp) else 1
    points, chosen = np.zeros((count, k, space)), np.empty((count, k), dtype=object)
    points[:, places], chosen[:, places] = grasp.points, list(faces)
    normals = np.zeros_like(points)
    normals[:, places] = grasp.normals
    for i in (i for i in range(k) if i not in places):
        cloud = bench.surface.cloud(i)
        drawn = rng.integers(len(cloud.points), size=count)
        points[:, i], normals[:, i], chosen[:, i] = cloud.points[drawn], cloud.normals[drawn], cloud.faces[drawn]
    placed = best_allowed(bench, points, normals, chosen)
    if placed is None:
        return None
    own = np.full((k, space), np.nan)
    own[places] = grasp.normals
    return Given(placed, own)


def best_allowed(bench: Workbench, points: FloatArray, normals: FloatArray, faces: FloatArray) -> Placed | None:
    """Return the placement that keeps the constraints and exerts the task best, of (b, k, space) points; None if none.

    Parameters
    ----------
    bench : Workbench
    points, normals : (b, k, space) array
        Metres, body frame; inward unit normals.
    faces : (b, k) array of str
    """
    hand = bench.hand_points.start(points, normals)
    allowed = bench.rows.violations(points, normals, hand) <= FEASIBLE
    if not allowed.any():
        return None
    rank = np.where(allowed, scores(bench, points, normals), -np.inf)
    best = int(np.argmax(rank))
    return Placed(tuple(faces[best]), points[best], {name: v[best] for name, v in hand.items()})
