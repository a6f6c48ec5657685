"""Task wrenches of a simulation, and the finger forces with which a hand answers them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import finger_forces
from nlpgrasp.simulation.conditions import slippery

MARGINS = np.arange(0.0, 0.41, 0.05)  # candidate friction margins, as shares
FOR_FRICTION, FOR_GRIP = 0.90, 0.95  # usable shares of the effort; the rest holds the fingertips in place


@dataclass(frozen=True)
class Loads:
    """Wrenches with the finger forces that answer them.

    Parameters
    ----------
    labels : tuple of m str
    wrenches : (m, d) array
        Wrenches to produce.
    forces : (m, n) array
        Contact by contact, as in G: they produce the wrenches.
    margins : (m,) array
        Unused share of friction; -1 where a wrench needs more than the effort.
    """

    labels: tuple[str, ...]
    wrenches: FloatArray
    forces: FloatArray
    margins: FloatArray


def answered(grasp: Grasp, labels: tuple[str, ...], wrenches: FloatArray, budget: ForceBudget, effort: float) -> Loads:
    """Return the wrenches with forces of a friction margin within an effort.

    The least forces lie on the boundary of the friction cones, where any disturbance makes fingers slip. For all but
    the hardest wrenches the hand has spare effort, and uses it for forces that need less friction, and for gripping.

    Parameters
    ----------
    grasp : Grasp
    labels : tuple of m str
    wrenches : (m, d) array
    budget : ForceBudget
    effort : float
        Units of the budget.
    """
    forces = np.zeros((len(wrenches), grasp.G.shape[1]))
    margins = np.full(len(wrenches), -1.0)
    for share in MARGINS:
        found = finger_forces(slippery(grasp, float(share)), wrenches, force_budget=budget)
        most = (1.0 if share == 0.0 else FOR_FRICTION) * effort
        good = found.feasible & (found.used <= most)
        forces[good], margins[good] = found.forces[good], share
    grip = gripping(grasp, budget)
    for i in np.flatnonzero(margins >= 0.0):
        forces[i] += _most_grip(grasp, forces[i], grip, budget, FOR_GRIP * effort) * grip
    return Loads(labels, wrenches, forces, margins)


def gripping(grasp: Grasp, budget: ForceBudget) -> FloatArray:
    """Return internal finger forces (n,) that press: the sum of the forces for opposite wrenches."""
    d, space = grasp.dimension, grasp.space
    ends = np.diag([1.0] * space + [grasp.mean_arm] * (d - space))
    found = finger_forces(grasp, np.concatenate([ends, -ends]), force_budget=budget)
    total = np.where(found.feasible[:, None], found.forces, 0.0)
    both = found.feasible[:d] & found.feasible[d:]
    return np.asarray((total[:d] + total[d:])[both].sum(axis=0))


def _most_grip(grasp: Grasp, x: FloatArray, grip: FloatArray, budget: ForceBudget, most: float) -> float:
    """Return the largest factor of internal forces that fits within an effort, by bisection."""
    allowed = budget.at(grasp.frames, grasp.contacts)
    size = float(allowed.used(grip[None])[0])
    low, high = 0.0, most / size if size > 0.0 else 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        used = float(allowed.used((x + middle * grip)[None])[0])
        low, high = (middle, high) if used <= most else (low, middle)
    return low
