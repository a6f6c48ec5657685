"""Where it may pay to begin: the best of thousands of random placements, by the bound on mu that screens them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.screening import screen
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

DRAWN = 4096  # placements
SCREENED = 1024  # of those that keep the constraints, at most
APART = 0.1  # of the body's size: placements nearer than that, contact by contact, are the same


@dataclass(frozen=True)
class Drawn:
    """Placements at random.

    Parameters
    ----------
    points, normals : (b, k, space) array
        Metres; inward unit normals.
    faces : (b, k) array of str
    """

    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]


def random_placements(bench: Workbench, count: int, rng: np.random.Generator) -> Drawn:
    """Return random placements over the sample points of the faces that each contact may use."""
    clouds = [bench.surface.cloud(i) for i in range(len(bench.problem.models))]
    each = [(cloud, rng.integers(len(cloud.points), size=count)) for cloud in clouds]
    return Drawn(
        np.stack([cloud.points[where] for cloud, where in each], axis=1),
        np.stack([cloud.normals[where] for cloud, where in each], axis=1),
        np.stack([cloud.faces[where] for cloud, where in each], axis=1),
    )


def scout(bench: Workbench, count: int, rng: np.random.Generator) -> list[Placed]:
    """Return up to ``count`` placements that exert the task, the best first and apart from each other.

    A start's own screening looks at tens of placements in some directions; here ``screen`` follows the weakest
    directions of each. None where chance finds no placement that keeps the constraints, and with a hand that has a pose
    of its own.
    """
    if not bench.follows_contacts:
        return []
    drawn = random_placements(bench, DRAWN, rng)
    points, normals, faces = drawn.points, drawn.normals, drawn.faces
    hand = bench.hand_points.start(points, normals)
    allowed = np.flatnonzero(bench.rows.violations(points, normals, hand) <= FEASIBLE)[:SCREENED]
    if not len(allowed):
        return []
    stack = GraspStack(points[allowed], normals[allowed], bench.problem.models, bench.problem.origin)
    bound = screen(stack, bench.problem.task, force_budget=bench.screening_budget)
    found: list[Placed] = []
    for n in np.argsort(-bound, kind="stable").tolist():
        i = int(allowed[n])
        if len(found) == count or bound[n] <= 0.0:
            break
        near = (np.max(np.linalg.norm(points[i] - other.points, axis=1)) for other in found)
        if min(near, default=np.inf) < APART * bench.scaling.length:
            continue
        found.append(Placed(tuple(faces[i]), points[i], {name: value[i] for name, value in hand.items()}))
    return found
