"""Combination of single contacts' supports into that of a grasp, by force budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget, L2Budget, PerFingerBudget, PerFingerSizeBudget, SharedBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.errors import InputError

SHARED_POWER = 8.0  # power of the norm that bounds the largest of the contacts' supports from above


@dataclass(frozen=True)
class Measure:
    """Rule ``phi_G(y)^p <= sum_i s_i(y)^p`` for the supports s_i of single contacts, exact but for a shared budget.

    Parameters
    ----------
    power : float
        p: 2 for the L2 budget, 1 for a unit of force a finger; 8 for a shared one, whose support is the largest s_i.
    lengths : bool
        Whether a contact's unit is the length of its force (``s = |P_K(z)|``) and not its normal force.
    exact : bool
        Whether the sum is the support itself.
    """

    power: float
    lengths: bool
    exact: bool = True

    @classmethod
    def of(cls, budget: ForceBudget) -> Measure:
        """Return the measure of a force budget.

        Raises
        ------
        InputError
            On a budget whose contacts' supports do not bound the grasp's: one of joint torques.
        """
        for kind, measure in MEASURES.items():
            if type(budget) is kind:
                return measure
        allowed = '"l2", "per_finger", "per_finger_size" or "shared" for a bound over all placements'
        raise InputError("force_budget", budget.kind, allowed)

    def support(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return s for force components z (..., n_i), at least zero, (...)."""
        if not self.lengths:
            return contact.extreme(z)[0]
        square = contact.squared_support(_work(contact, z), np)
        if square is None:
            return np.asarray(np.linalg.norm(contact.project(z), axis=-1))
        return np.asarray(np.sqrt(square))

    def powers(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return ``s^p`` for force components z (..., n_i), (...)."""
        found = self.powers_of(contact, _work(contact, z))
        return np.asarray(self.support(contact, z) ** self.power) if found is None else found

    def powers_of(self, contact: ContactModel, work: Work) -> FloatArray | None:
        """Return ``s^p`` for work along the normal, the surface and about the normal; None where it has no formula."""
        square = contact.squared_support(work, np) if self.lengths else None
        if square is None:
            return None
        return np.asarray(square if self.power == 2.0 else square ** (0.5 * self.power))

    def steepness(self, contact: ContactModel, components: int) -> float:
        """Return the Lipschitz constant of s in z: the length of the largest force of one unit."""
        if self.lengths:
            return 1.0
        return float(np.sqrt(1.0 + sum(c**2 for _, c in contact.blocks(components))))

    def combined(self, supports: FloatArray, axis: int) -> FloatArray:
        """Return the grasp's support from those of its contacts: exactly, for a shared budget too."""
        if not self.exact:
            return np.asarray(np.max(supports, axis=axis))
        return np.asarray(np.sum(supports**self.power, axis=axis) ** (1.0 / self.power))


MEASURES: dict[type[ForceBudget], Measure] = {
    L2Budget: Measure(2.0, lengths=True),
    PerFingerBudget: Measure(1.0, lengths=False),
    PerFingerSizeBudget: Measure(1.0, lengths=True),
    SharedBudget: Measure(SHARED_POWER, lengths=False, exact=False),
}


def _work(contact: ContactModel, z: FloatArray) -> Work:
    """Return the sizes of what z does along the normal, along the surface and about the normal."""
    space = 2 if z.shape[-1] == 2 else 3
    tangential = np.abs(z[..., 1]) if space == 2 else np.hypot(z[..., 1], z[..., 2]) if z.shape[-1] > 2 else np.zeros(1)
    torsion = np.abs(z[..., 3]) if z.shape[-1] > 3 else np.zeros(1)
    return Work(z[..., 0], tangential, torsion)
