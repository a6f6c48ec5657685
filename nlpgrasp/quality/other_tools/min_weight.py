"""Min-weight metric of FRoGGeR."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from nlpgrasp.errors import NlpgraspError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.arguments import over_stacks
from nlpgrasp.quality.certificate.rank import equilibrated, wrench_rank
from nlpgrasp.quality.other_tools.pyramids import pyramid_wrenches


@over_stacks
def min_weight(grasp: Grasp, edges: int = 8, *, first_edge: float = 0.0) -> float:
    """Return the normalised min-weight metric of FRoGGeR (Li et al. 2023, doi:10.1109/IROS55552.2023.10341806).

    The largest l such that edge wrenches with weights of at least l, summing to 1, balance; times their number, so
    that it is between 0 and 1. Positive weights can also balance wrenches that span less than wrench space: without
    full rank the value here is 0.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Point contacts, with friction or without, and soft contacts.
    edges, first_edge
        As for ``pyramid_wrenches``.

    Returns
    -------
    float, or (b,) array for a stack
        From 0 to 1, dimensionless.
    """
    wrenches = np.concatenate(pyramid_wrenches(grasp, edges, first_edge=first_edge))
    if wrench_rank(wrenches) < grasp.dimension:
        return 0.0
    wrenches, _ = equilibrated(wrenches)
    count, d = wrenches.shape
    equal = np.concatenate([wrenches.T, np.ones((1, count))])
    equal = np.concatenate([equal, np.zeros((d + 1, 1))], axis=1)
    above = np.concatenate([-np.eye(count), np.ones((count, 1))], axis=1)
    found = linprog(
        np.append(np.zeros(count), -1.0),
        A_ub=above,
        b_ub=np.zeros(count),
        A_eq=equal,
        b_eq=np.append(np.zeros(d), 1.0),
        bounds=[(0.0, None)] * (count + 1),
        method="highs",
    )
    if found.status == 2:  # no weights at all balance
        return 0.0
    if found.status != 0 or found.fun is None:
        raise NlpgraspError(f"min_weight: the linear program failed ({found.message})")
    return float(-np.float64(found.fun) * count)
