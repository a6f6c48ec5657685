"""The grasp wrench set ``G(B n K)`` through its support function (3.4-5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nlpgrasp.budgets import ForceBudget, L2Budget, force_budget
from nlpgrasp.budgets.base import project
from nlpgrasp.common.spatial import space_dimension
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import BilateralContact, ContactModel
from nlpgrasp.grasp.grasp import Grasp


@dataclass(frozen=True)
class WrenchSet:
    """``{G x : x in K, x in B}``, exactly.

    For the L2 budget ``phi(y) = ||P_K(G^T y)||`` by Moreau's decomposition, attained at ``x = P_K(G^T y)`` over its
    norm; the other budgets have closed forms too: no inner optimisation anywhere (theory, Section 2).

    Parameters
    ----------
    G : (d, n) array
        Grasp map, possibly after a linear change of wrench coordinates.
    contacts : sequence of ContactModel
    space : int
        2 or 3: the space the contacts live in.
    budget : ForceBudget
        B.
    """

    G: FloatArray
    contacts: Sequence[ContactModel]
    space: int
    budget: ForceBudget = L2Budget()  # noqa: RUF009  # no state

    @classmethod
    def of(cls, grasp: Grasp, budget: str | ForceBudget = "l2") -> WrenchSet:
        """Return the wrench set of a grasp.

        Raises
        ------
        InputError
            When the budget is unknown or does not bound the contacts' forces.
        """
        given = force_budget(budget)
        given.check(grasp.contacts, grasp.space)
        return cls(grasp.G, grasp.contacts, space_dimension(grasp.dimension), given.at(grasp.frames, grasp.contacts))

    @property
    def is_ellipsoid(self) -> bool:
        """Whether it is ``{G x : |x| <= 1}``: bilateral contacts only, and the L2 budget."""
        return isinstance(self.budget, L2Budget) and all(isinstance(c, BilateralContact) for c in self.contacts)

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of force components (m, n) onto the force domain K."""
        return project(z, self.contacts, self.space)

    def forces(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``phi(y | G(B n K))`` (m,) and finger forces that attain it (m, n)."""
        return self.budget.support(y @ self.G, self.contacts, self.space)

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``phi(y | G(B n K))`` (m,) and the wrenches that attain it (m, d)."""
        phi, x = self.forces(y)
        return phi, x @ self.G.T

    def transformed(self, matrix: FloatArray) -> WrenchSet:
        """Return the linear image of the set under ``matrix`` (d', d)."""
        return WrenchSet(matrix @ self.G, self.contacts, self.space, self.budget)
