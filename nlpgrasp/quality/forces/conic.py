"""Least finger forces under general force budgets, by a small conic program per wrench (Clarabel).

The grasp force optimisation problem (Boyd and Wegbreit 2007, doi:10.1109/TRO.2007.904901): minimise f subject to
``G x = w``, x in K and x in f B.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.conic import LONG, SHORT, cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import lifted
from nlpgrasp.quality.certificate.wrench_set import WrenchSet

TOLERANCES = (1e-11, 1e-9, 3e-8)  # tried in turn until the solver succeeds, each also with shorter steps


def least_forces(wrench_set: WrenchSet, wrenches: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return least forces (m, n) in units of the budget, and dual directions (m, d), for wrenches (m, d).

    A dual direction is the gradient of the least amount with respect to the wrench. NaN where the solver fails.
    """
    d = len(wrench_set.G)
    lift, matrices = lifted(wrench_set.contacts, wrench_set.space)
    n = lift.shape[1]
    rows: list[FloatArray] = [np.pad(wrench_set.G @ lift, [(0, 0), (0, 1)])]
    cones = [clarabel.ZeroConeT(d)]
    matrices = [np.pad(M, [(0, 0), (0, 1)]) for M in matrices]
    matrices += [np.concatenate([M[:, :-1] @ lift, M[:, -1:]], axis=1) for M in wrench_set.force_set.cones()]
    rows += [-M for M in matrices]
    cones += [cone_of(M) for M in matrices]
    A = sparse.csc_matrix(np.concatenate(rows))
    cost = np.zeros(n + 1)
    cost[n] = 1.0
    settings = [quiet_settings(tolerance, step) for tolerance in TOLERANCES for step in (LONG, SHORT)]
    forces, directions = np.full((len(wrenches), len(lift)), np.nan), np.full((len(wrenches), d), np.nan)
    nothing = sparse.csc_matrix((n + 1, n + 1))
    for i, w in enumerate(wrenches):
        b = np.zeros(A.shape[0])
        b[:d] = w
        for options in settings:
            found = clarabel.DefaultSolver(nothing, cost, A, b, cones, options).solve()
            if str(found.status) == "Solved":
                forces[i] = lift @ np.array(found.x)[:n]
                directions[i] = -np.array(found.z)[:d]
                break
            if "Infeasible" in str(found.status):
                break
    return forces, directions
