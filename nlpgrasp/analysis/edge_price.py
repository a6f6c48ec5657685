"""Shadow price of the margin from sharp edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nlpgrasp.bodies.mesh.facets import Facets
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.solution.prices import ShadowPrice

MILLIMETRE = 1e-3
AT = 1e-4  # over the body's size: a contact this near to the margin is at it
STEP = 1e-5  # over the body's size, of the central differences


def edge_price(bench: Workbench, placed: Placed, worth: Callable[[Placed], float]) -> ShadowPrice | None:
    """Return the change of mu per millimetre of margin; None where no contact of a smooth face is at the margin.

    A margin larger by h moves each contact that stands at it away from its edges by h. By the envelope theorem mu
    changes as the Lagrangian does with the contacts so moved, everything else left as it is.

    Parameters
    ----------
    bench : Workbench
    placed : Placed
        A local optimum.
    worth : callable
        The Lagrangian at another placement: weighted ratios and priced rows.
    """
    problem = bench.problem
    if problem.margin == 0.0 or isinstance(problem.body, Facets):
        return None
    each = zip(placed.faces, placed.points, strict=True)
    away = np.array([_away(bench, face, point) for face, point in each])
    if not np.any(away):
        return None
    h = STEP * problem.body.size
    more, less = (worth(bench.snapped(replace(placed, points=placed.points + s * h * away))) for s in (1.0, -1.0))
    return ShadowPrice("GraspProblem.edge_margin", problem.margin, MILLIMETRE, "1 mm", (more - less) / (2.0 * h) * 1e-3)


def _away(bench: Workbench, face: str, point: FloatArray) -> FloatArray:
    """Return the shortest step (space,) that takes a contact one metre away from each edge whose margin is active.

    Zero for a contact that stands at none.
    """
    body, h = bench.problem.body, STEP * bench.problem.body.size
    limits = body.surface_function(face, bench.problem.margin)

    def extents(p: FloatArray) -> FloatArray:
        return np.asarray(limits(p)[3].full()).ravel()

    at = np.flatnonzero(extents(point) >= -AT * body.size)
    if not at.size:
        return np.zeros(len(point))
    slopes = np.stack([(extents(point + h * e) - extents(point - h * e))[at] for e in np.eye(len(point))], axis=1)
    return np.asarray(-np.linalg.pinv(slopes / (2.0 * h)) @ np.ones(len(at)))
