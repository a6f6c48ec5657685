"""Force set of joint-torque limits, ``{x in K : |T x| <= 1}`` with one row of T per limit.

Contacts without common limits are independent: the set is a product over such groups, and its support function a sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.budgets.sets.torque_cone import TorqueCone
from nlpgrasp.budgets.sets.torque_polytope import TorquePolytope
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError

MOST_LISTED = 4  # most components of a contact whose extreme points are enumerated


class TorqueSet(ForceSet):
    """Force set ``{x in K : |T x| <= 1}`` of several contacts under joint-torque limits.

    Parameters
    ----------
    torques : (m, n) array
        T: torques over their limits per force component.
    contacts : sequence of ContactModel
    space : int
    name : str
        For messages.

    Raises
    ------
    InputError
        When some force loads no joint, so that the set is unbounded.
    """

    def __init__(self, torques: FloatArray, contacts: Sequence[ContactModel], space: int, name: str) -> None:
        super().__init__(contacts, space)
        self.torques, self._name = torques, name
        self._groups = [self._group(own) for own in _independent(torques, self.ranges)]

    @property
    def costly(self) -> bool:
        """Whether some group of contacts needs a conic program per support evaluation."""
        return any(isinstance(one, TorqueCone) for _, one in self._groups)

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along z (m, n), a sum over the groups, and maximisers (m, n)."""
        total, forces = np.zeros(len(z)), np.zeros_like(z)
        for where, one in self._groups:
            value, forces[:, where] = one.support(z[:, where])
            total += value
        return total, forces

    def prices(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return maximisers along z (m, n), and the shadow prices of the limits, (m, rows of T).

        Prices are positive at upper limits and negative at lower ones.
        """
        forces, prices = np.zeros_like(z), np.zeros((len(z), len(self.torques)))
        for where, rows, cone in self._cones:
            forces[:, where], prices[:, rows] = cone.priced(z[:, where])
        return forces, prices

    def used(self, x: FloatArray) -> FloatArray:
        """Return the largest ratios of torque to limit (m,) of forces (m, n)."""
        return np.asarray(np.max(np.abs(x @ self.torques.T), axis=1, initial=0.0))

    def cones(self) -> list[FloatArray]:
        """Return the conditions ``f - (T x)_j >= 0`` and ``f + (T x)_j >= 0`` of all limits, (1, n + 1) each."""
        signed = [sign * row for row in self.torques for sign in (1.0, -1.0)]
        return [np.append(row, 1.0)[None, :] for row in signed]

    def _group(self, own: list[int]) -> tuple[NDArray[np.intp], TorquePolytope | TorqueCone]:
        """Return component indices and force set of a group of coupled contacts."""
        where, rows = self._part(own)
        models = [self.contacts[i] for i in own]
        T = self.torques[np.ix_(rows, where)]
        name = f"{self._name}, contact{'s' * (len(own) > 1)} {', '.join(map(str, own))}"
        single = len(own) == 1 and T.shape[1] <= MOST_LISTED
        if single and sum(len(M) > 1 for M in models[0].cones(self.space)) <= 1:
            return where, TorquePolytope(models[0], T, self.space, name)
        return where, TorqueCone(models, T, self.space, name)

    def _part(self, own: list[int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the component indices of contacts, and the rows of T that involve them."""
        where = np.concatenate([np.arange(self.ranges[i].start, self.ranges[i].stop) for i in own])
        return where, np.flatnonzero(np.any(self.torques[:, where] != 0.0, axis=1))

    @cached_property
    def _cones(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], TorqueCone]]:
        result = []
        for own in _independent(self.torques, self.ranges):
            where, rows = self._part(own)
            models = [self.contacts[i] for i in own]
            result.append((where, rows, TorqueCone(models, self.torques[np.ix_(rows, where)], self.space, self._name)))
        return result


def torque_rows(
    jacobians: Sequence[FloatArray],
    limits: Sequence[FloatArray],
    frames: FloatArray,
    contacts: Sequence[ContactModel],
) -> list[FloatArray]:
    """Return each contact's matrix of torques over limits per force component, (m_i, n_i), from its Jacobian."""
    space = frames.shape[1]
    maps = [wrench_transform(np.zeros(space), f) @ c.basis(space) for f, c in zip(frames, contacts, strict=True)]
    return [(J.T / tau[:, None]) @ B[: len(J)] for J, tau, B in zip(jacobians, limits, maps, strict=True)]


def check_jacobian(name: str, J: FloatArray, space: int, d: int) -> None:
    """Raise for a Jacobian without rows of velocities, or of velocities and angular velocities."""
    if len(J) not in (space, d):
        raise InputError(name, f"{len(J)} rows", f"{space} or {d} rows")


def _independent(torques: FloatArray, parts: Sequence[slice]) -> list[list[int]]:
    """Return the groups of contacts without common limits."""
    seen = np.stack([np.any(torques[:, r] != 0.0, axis=1) for r in parts]).astype(float)  # (k, rows)
    count, labels = connected_components(sparse.csr_matrix(seen @ seen.T), directed=False)
    return [np.flatnonzero(labels == g).tolist() for g in range(count)]
