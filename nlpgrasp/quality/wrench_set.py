"""Grasp wrench set ``G(B ∩ K)`` by its support function (3.4-5), and its numerical rank."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.budgets import ForceBudget, force_budget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import derivative, project
from nlpgrasp.quality.grasp import Grasp, GraspStack

DIFFERENCE = 1e-6  # step of central differences of maximisers
RANK_TOLERANCE = 1e-10  # of the largest singular value


@dataclass(frozen=True)
class WrenchSet:
    """Grasp wrench set ``{G x : x in K, x in B}`` with an exact support function.

    For the L2 budget ``phi(y) = ||P_K(G^T y)||`` by Moreau's decomposition, attained at ``x = P_K(G^T y)`` over its
    norm; for the other budgets see ``nlpgrasp.budgets.torque_sets`` (docs/paper/09_support_functions.md).

    Parameters
    ----------
    G : (d, n) array
        Grasp map, possibly after a linear change of wrench coordinates.
    force_set : ForceSet
        ``B ∩ K``.
    terms : (d, n) array, optional
        Sums of the absolute products in G's entries; ``|G|`` by default.
    """

    G: FloatArray
    force_set: ForceSet
    terms: FloatArray | None = field(default=None, repr=False)

    @property
    def sizes(self) -> FloatArray:
        """Sums of the absolute products in G's entries, (d, n): they bound their rounding errors."""
        return np.abs(self.G) if self.terms is None else self.terms

    @classmethod
    def of(cls, grasp: Grasp, budget: str | ForceBudget = "l2") -> WrenchSet:
        """Return the wrench set of a grasp.

        Raises
        ------
        InputError
            When the budget is unknown or does not bound the contacts' forces.
        """
        force_bound = force_budget(budget)
        force_bound.check(grasp.contacts, grasp.space)
        return cls(grasp.G, force_bound.at(grasp.frames, grasp.contacts), grasp.G_sizes)

    @property
    def contacts(self) -> tuple[ContactModel, ...]:
        """Contact models, k of them."""
        return self.force_set.contacts

    @property
    def space(self) -> int:
        """Dimension of the contacts' space: 2 or 3."""
        return self.force_set.space

    @property
    def ranges(self) -> list[slice]:
        """Slice of each contact's components in the columns of G."""
        return self.force_set.ranges

    @property
    def is_ellipsoid(self) -> bool:
        """Whether the set is the ellipsoid ``{G x : |x| <= 1}``: only bilateral contacts, L2 budget."""
        return isinstance(self.force_set, L2Set) and not any(c.unilateral for c in self.contacts)

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of force components (m, n) onto the force domain K."""
        return project(z, self.contacts, self.space)

    def forces(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function ``phi(y | G(B ∩ K))`` (m,) and maximising finger forces (m, n)."""
        return self.force_set.support(y @ self.G)

    def variables(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,), and variables (m, l) of maximising finger forces A u."""
        return self.force_set.variables(y @ self.G)

    def exert(self, u: FloatArray) -> FloatArray:
        """Return the wrenches (m, d) of finger forces A u, given their variables (m, l)."""
        return u @ (self.G @ self.force_set.lift).T

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function ``phi(y | G(B ∩ K))`` (m,) and maximising wrenches (m, d)."""
        phi, x = self.forces(y)
        return phi, x @ self.G.T

    def curvature(self, y: FloatArray) -> FloatArray:
        """Return the Hessian (m, d, d) of ``phi^2 / 2`` at y (m, d) under the L2 budget.

        That is so whatever the budget of this set. ``phi^2 / 2 = |P_K(G^T y)|^2 / 2`` is differentiable everywhere;
        where its gradient has kinks, a generalised Hessian is returned.
        """
        z = y @ self.G
        blocks = zip(derivative(z, self.contacts, self.space), self.ranges, strict=True)
        return np.concatenate([self.G[:, r] @ block for block, r in blocks], axis=2) @ self.G.T

    def hessian(self, y: FloatArray) -> FloatArray:
        """Return the Hessian (m, d, d) of the support function at unit directions y (m, d).

        Under the L2 budget it is ``(H - g g^T) / phi`` with H of ``curvature`` and the gradient g; a direction without
        support has a zero one. Other budgets take central differences of the maximising wrenches.
        """
        if isinstance(self.force_set, L2Set):
            phi, wrench = self.support(y)
            outer = wrench[:, :, None] * wrench[:, None, :]
            return (self.curvature(y) - outer) / np.where(phi > 0.0, phi, np.inf)[:, None, None]
        return central_differences(self.support, y)

    def transformed(self, matrix: FloatArray) -> WrenchSet:
        """Return the linear image of the set under ``matrix`` (d', d)."""
        return WrenchSet(matrix @ self.G, self.force_set, np.abs(matrix) @ self.sizes)


def central_differences(support: Callable[[FloatArray], tuple[FloatArray, FloatArray]], y: FloatArray) -> FloatArray:
    """Return the Hessians (m, d, d) of a support function at unit directions y (m, d), from its maximisers."""
    m, d = y.shape
    nearby = np.concatenate([(y[:, None] + h * np.eye(d)).reshape(-1, d) for h in (DIFFERENCE, -DIFFERENCE)])
    forward, backward = support(nearby)[1].reshape(2, m, d, d)
    hessian = (forward - backward) / (2.0 * DIFFERENCE)
    return np.asarray(0.5 * (hessian + hessian.transpose(0, 2, 1)))


def numerical_rank(values: FloatArray) -> int:
    """Return the number of singular values that count as nonzero."""
    return int(np.sum(values > RANK_TOLERANCE * max(float(np.max(values, initial=0.0)), 1e-300)))


def equilibrated(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return wrenches (m, d) with columns scaled to unit norm, and the column norms (d,), 1 for zero columns.

    Forces and torques have different units; the rank must not depend on them.
    """
    scale = np.linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return rows / scale, scale


def wrench_rank(rows: FloatArray) -> int:
    """Return the dimension of the span of wrenches (m, d), independent of units."""
    return numerical_rank(np.asarray(np.linalg.svd(equilibrated(rows)[0], compute_uv=False), dtype=np.float64))


def torque_factors(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    """Return the factors (d,) of wrench components: 1 for forces, ``1 / torque_scale`` for torques."""
    scale = number("torque_scale", torque_scale, above=0.0)
    return np.array([1.0] * grasp.space + [1.0 / scale] * (grasp.dimension - grasp.space))
