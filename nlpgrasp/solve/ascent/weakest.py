"""The directions in which a grasp is weakest against a task, found by descent from many starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.certificate.containment import Containment, conditioned
from nlpgrasp.quality.certificate.minimise import descend, random_directions, separated
from nlpgrasp.quality.certificate.sandwich import narrowed
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.tasks import Task

SLACK = 1.25  # keep local minima up to this factor above the least
KEEP = 64
SEPARATION = 0.97
HULL_GAP, HULL_CELLS = 2e-3, 600


@dataclass(frozen=True)
class Weakest:
    """Local minimisers of ``phi_G / phi_A``.

    Parameters
    ----------
    value : float
        The least ratio found: an upper bound on mu, and nearly always mu itself.
    directions : (m, d) array
        Wrench-space directions, least first, each scaled so that ``phi_A = 1``.
    """

    value: float
    directions: FloatArray


@dataclass(frozen=True)
class Descents:
    """How thoroughly weak directions are searched for.

    Parameters
    ----------
    fresh : int
        Random starting directions.
    iterations : int
        Of each descent.
    gap : float
        Relative: how near to certified the least ratio is where directions come from a polytope.
    """

    fresh: int
    iterations: int
    gap: float = HULL_GAP


THOROUGH, AFTER_A_STEP, QUICK = Descents(150, 40), Descents(60, 30), Descents(60, 25)


def weakest_at(
    bench: Workbench,
    placed: Placed,
    rng: np.random.Generator,
    known: FloatArray | None = None,
    descents: Descents = THOROUGH,
) -> Weakest:
    """Return the weakest directions of a placed state against the problem's task; see ``weakest_directions``."""
    return weakest_directions(bench.grasp(placed), bench.problem.task, bench.budget(placed), rng, known, descents)


def weakest_directions(
    grasp: Grasp,
    task: Task,
    budget: ForceBudget,
    rng: np.random.Generator,
    known: FloatArray | None = None,
    descents: Descents = THOROUGH,
) -> Weakest:
    """Return the weakest directions of a grasp.

    Parameters
    ----------
    grasp : Grasp
    task : Task
    budget : ForceBudget
    rng : numpy.random.Generator
    known : (m, d) array, optional
        Directions to start from as well, for example those of a nearby grasp.
    descents : Descents
    """
    problem, proof = conditioned(WrenchSet.of(grasp, budget), task)
    if problem is None:
        y = np.zeros((0, grasp.dimension)) if proof is None else _unit_reach(task, proof[None, :])
        return Weakest(0.0, y)
    if isinstance(budget, L2Budget) and task.is_centred:
        start = random_directions(descents.fresh, problem.rank, rng)
        if known is not None and len(known):
            old = np.linalg.lstsq(problem.matrix.T, known.T, rcond=None)[0].T
            old = old[np.linalg.norm(old, axis=1) > 0.0]
            start = np.concatenate([old, start])
        found, values = descend(problem, start, descents.iterations)
    else:
        found, values = _from_hull(problem, descents.gap)
    order = np.argsort(values)
    order = order[values[order] <= SLACK * values[order[0]] + 1e-12]
    chosen = separated(found, order, SEPARATION, KEEP)
    return Weakest(float(values[chosen[0]]), _unit_reach(task, found[chosen] @ problem.matrix))


def _from_hull(problem: Containment, gap: float) -> tuple[FloatArray, FloatArray]:
    """Return directions and ratios from the certificate's polytope: descents stop at the kinks of other budgets."""
    state = narrowed(problem, gap)
    found = state.worst[None, :]
    if state.hull is not None and problem.rank > 1:
        cells = state.hull.worst(SLACK * state.upper, HULL_CELLS)
        found = np.concatenate([found, state.hull.normals(cells)])
    return found, problem.ratio(found)[0]


def _unit_reach(task: Task, y: FloatArray) -> FloatArray:
    reach = task.support(y)[0]
    return np.asarray(y[reach > 0.0] / reach[reach > 0.0][:, None])
