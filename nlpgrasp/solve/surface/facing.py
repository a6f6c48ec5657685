"""Pairs of places on a mesh that face each other: where jaws begin, and how they move.

Two places that are drawn at random hardly ever face each other, and an ascent that begins elsewhere ends where it first
meets a pair that does, such as on a thin wall. Here each of many points of the mesh is paired with all points that its
normal leads to, through the body.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.screening import screen
from nlpgrasp.solve.surface.regained import ALLOWED, opposite, regained
from nlpgrasp.solve.surface.scored import Scored
from nlpgrasp.solve.workbench.across import pairs_across
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

NEARLY = 0.1  # relative to the rows' scales: pairs that break more are not brought back to the constraints
SCREENED = 1500  # pairs that are compared
TRIED = 4  # times as many pairs as are wanted that are brought back
APART = 0.15  # of the body's size: pairs nearer than that, contact by contact, are the same


def has_jaws_on_mesh(problem: GraspProblem) -> bool:
    """Return whether two contacts on a mesh have to face each other."""
    return isinstance(problem.hand, ParallelJaw) and isinstance(problem.body, Mesh)


def facing_pairs(bench: Workbench, count: int) -> list[Placed]:
    """Return up to ``count`` pairs on a mesh that keep all constraints, the best first and apart from each other.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh and two contacts.
    count : int

    Returns
    -------
    list of Placed
        Contacts on the mesh itself; the same for every seed. Pairs that cannot exert the task are left out.
    """
    points, normals = _promising(bench)
    scored = Scored(bench, np.random.default_rng(0))
    found: list[tuple[FloatArray, FloatArray]] = []
    for i in _apart_from_each_other(bench, points, np.arange(len(points)), TRIED * count):
        start = Placed(_faces(bench), points[i], {})
        there = regained(bench, start, points[i], normals[i], scored)
        if bench.rows.violations(there[0][None], there[1][None], {})[0] <= ALLOWED:
            found.append(there)
    if not found:
        return []
    points, normals = (np.stack(each) for each in zip(*found, strict=True))
    bound = _bound(bench, points, normals)
    order = np.argsort(-bound, kind="stable")
    best = _apart_from_each_other(bench, points, order[bound[order] > 0.0], count)
    return [Placed(_faces(bench), points[i], {}) for i in best]


def _faces(bench: Workbench) -> tuple[str, str]:
    name = bench.problem.body.face_names[0]
    return name, name


def _promising(bench: Workbench) -> tuple[FloatArray, FloatArray]:
    """Return pairs (b, 2, 3) that break the constraints by little, the best first, with their normals."""
    points, normals = _through(bench)
    both = np.concatenate([points, points[:, ::-1]]), np.concatenate([normals, normals[:, ::-1]])  # either way about
    broken = bench.rows.violations(*both, {})
    kept = np.flatnonzero(broken <= NEARLY)
    if kept.size > SCREENED:
        kept = kept[np.argsort(broken[kept], kind="stable")[:SCREENED]]
    bound = _bound(bench, both[0][kept], both[1][kept])
    order = kept[np.argsort(-bound, kind="stable")]
    return both[0][order], both[1][order]


def _bound(bench: Workbench, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return how well pairs exert the task, (b,)."""
    problem = bench.problem
    if not len(points):
        return np.zeros(0)
    stack = GraspStack(points, normals, problem.models, problem.origin)
    return screen(stack, problem.task, force_budget=bench.screening_budget)


def _apart_from_each_other(bench: Workbench, points: FloatArray, order: NDArray[np.int64], count: int) -> list[int]:
    """Return the first ``count`` pairs in an order that are apart from those before, whichever way about."""
    taken: list[int] = []
    for i in order.tolist():
        if len(taken) == count:
            break
        near = (np.max(np.linalg.norm(points[i] - q, axis=1)) for j in taken for q in (points[j], points[j][::-1]))
        if min(near, default=np.inf) >= APART * bench.scaling.length:
            taken.append(i)
    return taken


def _through(bench: Workbench) -> tuple[FloatArray, FloatArray]:
    """Return pairs of places (b, 2, 3), one at a sample point, the other where its normal leaves the body; normals."""
    points, normals = pairs_across(bench.surface.mesh_cloud)
    # the other end where the normal leads to, and not at the sample point near it
    lengths = np.einsum("ij,ij->i", points[:, 1] - points[:, 0], normals[:, 0])
    points[:, 1] = points[:, 0] + lengths[:, None] * normals[:, 0]
    return opposite(bench, points, normals, 0)
