"""From a grasp on the mesh to a better one on the mesh: what is best on the smooth surface is not the best here."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import mu
from nlpgrasp.solve.workbench.mesh_climb import AGAIN
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

WIDTH = 0.05  # relative, of the certificates that grasps are compared by


def climbed(
    bench: Workbench, start: Placed, grasp: Grasp, rng: np.random.Generator, stop: Stop, again: int = AGAIN
) -> Grasp:
    """Return the best of a grasp and those uphill of it on the mesh that keep the constraints as well.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh.
    start : Placed
        Where the grasp began; its hand is the grasp's.
    grasp : Grasp
        On the mesh, with the mesh's own normals.
    rng : numpy.random.Generator
    stop : Stop
    again : int
        How often exchanges of contacts begin again.
    """
    climb = bench.mesh_climb
    if climb is None or stop.requested():
        return grasp
    hand, budget = start.repeated_hand(1), bench.budget(start)

    def broken(found: Grasp) -> float:
        return float(bench.rows.violations(found.points[None], found.normals[None], hand)[0])

    def worth(found: Grasp) -> float:
        bounds = mu(found, bench.problem.task, WIDTH, force_budget=budget)
        return bounds.upper if bounds.lower > 0.0 else 0.0  # descents find the upper bound, mostly mu itself

    best, value, limit = grasp, worth(grasp), max(FEASIBLE, broken(grasp))
    for points, normals in climb.improved(grasp.points, grasp.normals, rng, again):
        found = bench.grasp_at(points, normals)
        if broken(found) <= limit and (there := worth(found)) > value:
            best, value = found, there
    return best
