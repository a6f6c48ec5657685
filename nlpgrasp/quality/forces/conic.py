"""Least finger forces under budgets that are not the L2 ball: a small conic program a wrench, solved by Clarabel.

The grasp force optimisation problem (Boyd and Wegbreit 2007, doi:10.1109/TRO.2007.904901): minimise f subject to
``G x = w``, x in K and x in f B.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.conic import cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.certificate.wrench_set import WrenchSet

TOLERANCES = (1e-11, 1e-9, 3e-8)  # one after another until the solver reaches it


def least_forces(wrench_set: WrenchSet, wrenches: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return forces that use the least of the budget, and dual directions: (m, d) to (m, n) and (m, d).

    A dual direction is the gradient of the least amount with respect to the wrench. NaN where the solver found none.
    """
    d, n = wrench_set.G.shape
    rows: list[FloatArray] = [np.concatenate([wrench_set.G, np.zeros((d, 1))], axis=1)]
    cones = [clarabel.ZeroConeT(d)]
    matrices = []
    for contact, r in zip(wrench_set.contacts, wrench_set.ranges, strict=True):
        for M in contact.cones(wrench_set.space):
            matrices.append(np.zeros((len(M), n + 1)))
            matrices[-1][:, r] = M
    matrices += wrench_set.force_set.cones()
    rows += [-M for M in matrices]
    cones += [cone_of(M) for M in matrices]
    A = sparse.csc_matrix(np.concatenate(rows))
    cost = np.zeros(n + 1)
    cost[n] = 1.0
    solvers = _Solvers(A, cost, cones)
    forces, directions = np.full((len(wrenches), n), np.nan), np.full((len(wrenches), d), np.nan)
    for i, w in enumerate(wrenches):
        found = solvers.solve(np.concatenate([w, np.zeros(A.shape[0] - d)]))
        if found is not None:
            forces[i], directions[i] = found[0][:n], -found[1][:d]
    return forces, directions


class _Solvers:
    """One program with many right-hand sides: a solver for each tolerance, set up when it is first needed.

    Parameters
    ----------
    A : (m, v) sparse array
    cost : (v,) array
    cones : list of Clarabel's cones
    """

    def __init__(self, A: sparse.csc_matrix, cost: FloatArray, cones: list[object]) -> None:
        self._data = (sparse.csc_matrix((A.shape[1], A.shape[1])), cost, A)
        self._cones = cones
        self._ready: dict[float, clarabel.DefaultSolver] = {}

    def solve(self, b: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return primal and dual solution for ``b - A x`` in the cones; None where no tolerance is reached."""
        for tolerance in TOLERANCES:
            found = self._solver(tolerance, b).solve()
            if str(found.status) == "Solved":
                return np.array(found.x), np.array(found.z)
            if "Infeasible" in str(found.status):
                return None
        return None

    def _solver(self, tolerance: float, b: FloatArray) -> clarabel.DefaultSolver:
        if tolerance in self._ready:
            self._ready[tolerance].update(b=b)
        else:
            settings = quiet_settings(tolerance)
            settings.presolve_enable = False  # which would fix the right-hand side
            self._ready[tolerance] = clarabel.DefaultSolver(*self._data, b, self._cones, settings)
        return self._ready[tolerance]
