"""Force set of joint-torque limits, with a conic program per support evaluation.

For contacts that share joints, have five or six components, or two quadratic cones: their extreme points are too many
to enumerate.
"""

from __future__ import annotations

from collections.abc import Sequence

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.budgets.sets.torque_polytope import check_bounded
from nlpgrasp.common.conic import cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import lifted, project

TOLERANCE = 1e-10  # of the conic solver
INSIDE = 1.0 - 1e-9  # scale of the maximiser, which keeps it within the limits despite the solver's tolerance


class TorqueCone:
    """Force set ``{x in K : |T x| <= 1}`` of one or several contacts, by conic programs.

    Parameters
    ----------
    contacts : sequence of ContactModel
    torques : (m, n) array
        T: joint torques over their limits per force component.
    space : int
    name : str
        For messages.

    Raises
    ------
    InputError
        When some force of the cones loads no joint, so that the set is unbounded.
    """

    def __init__(self, contacts: Sequence[ContactModel], torques: FloatArray, space: int, name: str) -> None:
        check_bounded(contacts, torques, space, name)
        self._contacts, self._torques, self._space = contacts, torques, space
        self._lift, cones = lifted(contacts, space)
        n = self._lift.shape[1]
        loads = torques @ self._lift
        self._cones = [clarabel.NonnegativeConeT(2 * len(torques)), *[cone_of(M) for M in cones]]
        self._A = sparse.csc_matrix(np.concatenate([loads, -loads, *[-M for M in cones]]))
        self._b = np.zeros(self._A.shape[0])
        self._b[: 2 * len(torques)] = 1.0
        self._none = sparse.csc_matrix((n, n))
        self._options = quiet_settings(TOLERANCE)

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along z (m, n), and maximisers (m, n)."""
        force = self.priced(z)[0]
        return np.maximum(0.0, np.sum(z * force, axis=1)) / INSIDE, force

    def priced(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return maximisers along z (b, n), and the shadow prices of the torque limits, (b, m).

        Prices are positive at upper limits and negative at lower ones.
        """
        force, prices = np.zeros_like(z), np.zeros((len(z), len(self._torques)))
        m = len(self._torques)
        for i, row in enumerate(z):
            size = float(np.linalg.norm(row))
            if size == 0.0:
                continue
            cost = -(row / size) @ self._lift
            found = clarabel.DefaultSolver(self._none, cost, self._A, self._b, self._cones, self._options).solve()
            x = project((self._lift @ np.array(found.x))[None, :], self._contacts, self._space)[0]
            force[i] = x * INSIDE / max(1.0, float(np.max(np.abs(self._torques @ x), initial=0.0)))
            dual = np.array(found.z)
            prices[i] = size * (dual[:m] - dual[m : 2 * m])
        return force, prices
