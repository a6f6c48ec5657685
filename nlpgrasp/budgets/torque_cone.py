"""One contact's forces within its cone and joint-torque limits, by a conic program a direction.

For contacts of five and six components, or with two round cones, there are too many kinds of extreme points to list.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.budgets.torque_polytope import check_bounded
from nlpgrasp.conic_solver import cone_of, quiet_settings
from nlpgrasp.contacts import ContactModel
from nlpgrasp.validation import FloatArray

TOLERANCE = 1e-10
INSIDE = 1.0 - 1e-9  # keeps the attaining force within the limits to the solver's tolerance


class TorqueCone:
    """The forces ``{x in K_i : |T x| <= 1}`` of one contact.

    Parameters
    ----------
    contact : ContactModel
    torques : (m, n) array
        T: joint torques over their limits per force component.
    space : int
    name : str
        For messages.

    Raises
    ------
    InputError
        When some force of the cone needs no torque at all: the set is unbounded.
    """

    def __init__(self, contact: ContactModel, torques: FloatArray, space: int, name: str) -> None:
        n = contact.components(space)
        check_bounded(contact, torques, n, name)
        self._contact, self._torques = contact, torques
        cones = contact.cones(space)
        self._cones = [clarabel.NonnegativeConeT(2 * len(torques)), *[cone_of(M) for M in cones]]
        self._A = sparse.csc_matrix(np.concatenate([torques, -torques, *[-M for M in cones]]))
        self._b = np.zeros(self._A.shape[0])
        self._b[: 2 * len(torques)] = 1.0
        self._none = sparse.csc_matrix((n, n))
        self._options = quiet_settings(TOLERANCE)

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest work and a force that does it: (m, n) to (m,) and (m, n)."""
        value, force = np.zeros(len(z)), np.zeros_like(z)
        for i, row in enumerate(z):
            size = float(np.linalg.norm(row))
            if size == 0.0:
                continue
            solver = clarabel.DefaultSolver(self._none, -row / size, self._A, self._b, self._cones, self._options)
            x = self._contact.project(np.array(solver.solve().x)[None, :])[0]
            x *= INSIDE / max(1.0, float(np.max(np.abs(self._torques @ x))))
            value[i], force[i] = max(0.0, float(row @ x)) / INSIDE, x
        return value, force
