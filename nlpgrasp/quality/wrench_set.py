"""The grasp wrench set ``G(B n K)`` through its support function (3.4-5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.contacts import ContactModel
from nlpgrasp.grasp import Grasp
from nlpgrasp.spatial import space_dimension
from nlpgrasp.validation import FloatArray


@dataclass(frozen=True)
class WrenchSet:
    """``{G x : x in K, ||x|| <= 1}``, exactly.

    By Moreau's decomposition ``phi(y) = ||P_K(G^T y)||``, attained at ``x = P_K(G^T y)`` over its norm: a
    closed form, no inner optimisation (theory, Section 2).

    Parameters
    ----------
    G : (d, n) array
        Grasp map, possibly after a linear change of wrench coordinates.
    contacts : sequence of ContactModel
    space : int
        2 or 3: the space the contacts live in.
    """

    G: FloatArray
    contacts: Sequence[ContactModel]
    space: int

    @classmethod
    def of(cls, grasp: Grasp) -> WrenchSet:
        """Return the wrench set of a grasp."""
        return cls(grasp.G, grasp.contacts, space_dimension(grasp.dimension))

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of force components (m, n) onto the force domain K."""
        if all(c == self.contacts[0] for c in self.contacts):
            shape = (z.shape[0], len(self.contacts), -1)
            return self.contacts[0].project(z.reshape(shape)).reshape(z.shape)
        parts, start = [], 0
        for contact in self.contacts:
            stop = start + contact.components(self.space)
            parts.append(contact.project(z[:, start:stop]))
            start = stop
        return np.concatenate(parts, axis=1)

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``phi(y | G(B n K))`` (m,) and the wrenches that attain it (m, d)."""
        x = self.project(y @ self.G)
        phi = np.linalg.norm(x, axis=1)
        return phi, (x / np.where(phi > 0.0, phi, 1.0)[:, None]) @ self.G.T

    def transformed(self, matrix: FloatArray) -> WrenchSet:
        """Return the linear image of the set under ``matrix`` (d', d)."""
        return WrenchSet(matrix @ self.G, self.contacts, self.space)
