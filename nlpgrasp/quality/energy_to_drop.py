"""Energy to drop: the least energy of a push that contacts on springs do not bear."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu
from nlpgrasp.quality.wrench_set import equilibrated, numerical_rank
from nlpgrasp.tasks import Task, TaskEllipsoid


def energy_to_drop(
    grasp: Grasp, task: Task | None, budget: ForceBudget, stiffness: float = 1000.0, rtol: float = 0.01
) -> float:
    """Return a lower bound on the energy, joules, of a push of any direction that one newton of the budget cannot bear.

    Each component of a contact's force has a spring of a stiffness k, so that a wrench w of the fingers stores ``w^T
    K^-1 w / 2`` with ``K = k G G^T`` (2.5-2). Least it is where the ellipsoid of equal energies ``{K^(1/2) u : |u| <=
    r}`` touches the boundary of the wrench set: r is mu of the grasp for this ellipsoid as a task, and the energy
    ``r^2 / 2``. It is 0 where the contacts leave a motion free. With a budget of F newtons it is F^2 times as large.

    Parameters
    ----------
    grasp : Grasp
    task : Task, optional
        Not used: the push has any direction.
    budget : ForceBudget
    stiffness : float
        k, newtons a metre.
    rtol : float
        Relative gap of the certified mu.
    """
    del task
    sizes = np.linalg.svd(equilibrated(grasp.G.T)[0], compute_uv=False)
    if numerical_rank(np.asarray(sizes, dtype=float)) < len(grasp.G):
        return 0.0
    stiffnesses, directions = np.linalg.eigh(stiffness * grasp.G @ grasp.G.T)
    energies = TaskEllipsoid(np.sqrt(stiffnesses), directions=directions)
    return 0.5 * mu(grasp, energies, rtol, force_budget=budget).lower ** 2
