"""Least friction with which a task is held, and least force at each friction, by certificates.

The force domains grow with friction, ``K(f)`` is in ``K(g)`` for f <= g, and with them the wrench set: what is proved
at one friction holds for every larger one, and what is refuted at one is refuted for every smaller one. So bisection
between certificates brackets the least friction, and both ends are proved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import FORCE_UNIT, format_number
from nlpgrasp.common.validation import array, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_friction import can_press
from nlpgrasp.quality.least_grip import least_grip
from nlpgrasp.quality.measures import mu
from nlpgrasp.tasks import Task

LARGEST = 10.0  # friction above which is not searched
SMALLEST = 1e-3  # share of the contacts' friction below which is not searched
COARSEST, FINEST = 0.3, 3e-4  # relative widths of the certificates of mu that decide at one friction
LEAST_RTOL = 1e-3  # of the interval of friction: certificates do not tell closer frictions apart
SLACK = 1e-3  # share of the force by which a task is out of reach where it counts as lost


def critical_friction(
    grasp: Grasp,
    task: Task,
    *,
    finger_force: float | None = None,
    total: float | None = None,
    rtol: float = 0.02,
    largest: float = LARGEST,
) -> Bounds:
    """Return the least friction with which a task is held: below ``lower`` it is lost, above ``upper`` held.

    Parameters
    ----------
    grasp : Grasp
        Its contacts have one friction coefficient, or none. Torsional friction is in proportion to it.
    task : Task
        Wrenches to exert, about the grasp's torque origin.
    finger_force : float, optional
        Newtons: largest normal force of each finger. By default any forces count.
    total : float, optional
        Newtons: largest sum of the normal forces.
    rtol : float
        Relative width of the interval, at least 0.001. It is wider where the forces hardly depend on friction.
    largest : float
        Friction above which is not searched.

    Returns
    -------
    Bounds
        Both ends are certified. ``lower`` is 0 where a thousandth of the friction is still enough, ``upper`` is
        infinite where ``largest`` is not.

    Raises
    ------
    InputError
        When contacts have no friction, or different coefficients, both limits are given, or a number is out of range.
    """
    require_grasp(grasp)
    task = task_for(task, grasp)
    if finger_force is not None and total is not None:
        raise InputError("total", total, "one of finger_force and total")
    name, limit = ("finger_force", finger_force) if total is None else ("total", total)
    quality = 0.0 if limit is None else 1.0 / number(name, limit, above=0.0)
    budget = "per_finger" if total is None else "shared"
    rtol, largest = number("rtol", rtol, at_least=LEAST_RTOL), number("largest", largest, above=0.0)
    return _bracket(grasp, lambda weaker: _is_held(weaker, task, budget, quality), rtol, largest)


@dataclass(frozen=True)
class HoldingForce:
    """Force that holds a task: how it is counted, and the largest that is allowed.

    Parameters
    ----------
    budget : ForceBudget
        Counts the force. One that is absolute, such as joint torques, also limits it.
    most : float or None
        Newtons: largest force of each finger; of jaws, normal force of each. None for forces of any size.
    jaws : bool
        Whether the contacts are the jaws of a gripper, which press against each other with the same force.
    """

    budget: ForceBudget
    most: float | None = None
    jaws: bool = False

    @property
    def unit(self) -> str:
        """Unit of the force."""
        return FORCE_UNIT if self.jaws else self.budget.unit

    @property
    def amount(self) -> str:
        """Text on what is counted."""
        return "normal force of each jaw" if self.jaws else self.budget.amount

    @property
    def scope(self) -> str:
        """Text on the largest force that is allowed."""
        if self.budget.absolute and not self.jaws:
            return "within the joints' torque limits"
        if self.most is None:
            return "with forces of any size"
        return f"with at most {format_number(self.most)} {FORCE_UNIT} a {'jaw' if self.jaws else 'finger'}"

    def least(self, grasp: Grasp, task: Task, rtol: float, *, seed: int = 0) -> Bounds:
        """Return the least force that holds a task, certified; infinite where none is known to."""
        if self.jaws:
            return least_grip(grasp, task, rtol, seed=seed)
        return _least_force(grasp, task, self.budget, rtol, seed)

    def holds(self, grasp: Grasp, task: Task, *, seed: int = 0) -> tuple[bool | None, str]:
        """Return whether a certificate proves that allowed forces hold a task, or refutes it; None if it does neither.

        The second value is what the certificate rests on besides real arithmetic, as in ``Bounds``.
        """
        budget, quality = self._limit(grasp)
        verdict, trust = _is_held(grasp, task, budget, quality, seed)
        return (None if verdict and self.jaws and not can_press(grasp) else verdict), trust

    def critical_friction(self, grasp: Grasp, task: Task, rtol: float = 0.02) -> Bounds:
        """Return the least friction with which allowed forces hold a task, as ``critical_friction``."""
        return _bracket(grasp, lambda weaker: self.holds(weaker, task), rtol, LARGEST)

    def _limit(self, grasp: Grasp) -> tuple[str | ForceBudget, float]:
        """Return the budget that allows forces, and the least mu under it."""
        if self.jaws:
            return "shared", 0.0 if self.most is None else 0.5 / self.most
        if self.budget.absolute:
            return self.budget, 1.0
        if self.most is None:  # any budget: this one is the quickest
            return "per_finger" if all(contact.unilateral for contact in grasp.contacts) else "l2", 0.0
        return "per_finger_size", 1.0 / self.most


def _bracket(grasp: Grasp, holds: Callable[[Grasp], tuple[bool | None, str]], rtol: float, largest: float) -> Bounds:
    """Return the least friction at which ``holds`` is true, between the nearest that it decides, by bisection."""
    base = common_friction(grasp.contacts)
    # frictions: the largest refuted, the least that was not; the largest that was not proved, the least that was
    lost, not_lost, not_held, held = 0.0, np.inf, 0.0, np.inf
    trial, trust = min(base, largest), {0.0: "", np.inf: ""}  # what the verdict at each friction rests on

    def is_closed(low: float, high: float) -> bool:
        return high <= (1.0 + rtol / 3.0) * low or low >= largest or high <= SMALLEST * base

    while True:
        verdict, trust[trial] = holds(grasp.with_friction(trial / base))
        if verdict is False:
            lost = max(lost, trial)
        else:
            not_lost = min(not_lost, trial)
        if verdict is True:
            held = min(held, trial)
        else:
            not_held = max(not_held, trial)
        gaps = [gap for gap in ((lost, not_lost), (not_held, held)) if not is_closed(*gap)]
        if held <= (1.0 + rtol) * lost or not gaps:
            return Bounds(lost, held, kind="friction", trust="; ".join(filter(None, {trust[lost], trust[held]})))
        low, high = max(gaps, key=lambda gap: gap[1] / max(gap[0], SMALLEST * base))
        if not np.isfinite(high):
            trial = min(2.0 * low, largest)
        else:
            trial = float(np.sqrt(low * high)) if low > 0.0 else max(0.1 * high, SMALLEST * base)


def _is_held(
    grasp: Grasp, task: Task, budget: str | ForceBudget, quality: float, seed: int = 0
) -> tuple[bool | None, str]:
    """Return whether a certificate proves that mu is at least ``quality``, or refutes it; and what it rests on.

    Certificates are narrowed only as far as the decision needs. With ``quality`` 0 any positive mu is enough.
    """
    width = COARSEST
    while True:
        bounds = mu(grasp, task, width, force_budget=budget, seed=seed)
        if bounds.lower > 0.0 and bounds.lower >= quality:
            return True, bounds.trust
        if bounds.upper == 0.0 or bounds.upper < (1.0 - SLACK) * quality:
            return False, bounds.trust
        if width <= FINEST or bounds.limit:
            return None, ""
        excess = bounds.upper / quality - 1.0 if quality > 0.0 else np.inf
        width = max(FINEST, min(0.7 * excess, 0.1 * width))


def force_curve(
    grasp: Grasp, task: Task, frictions: ArrayLike, *, total: bool = False, rtol: float = 0.01
) -> tuple[Bounds, ...]:
    """Return the least normal force, newtons, with which a task is held at each friction coefficient.

    Parameters
    ----------
    grasp : Grasp
        As for ``critical_friction``.
    task : Task
        As for ``critical_friction``.
    frictions : (m,) array
        Friction coefficients, above 0.
    total : bool
        Whether the sum of the normal forces is meant, not the largest of them.
    rtol : float
        Relative width of the intervals.

    Returns
    -------
    tuple of m Bounds
        Certified; infinite where no force is known to hold the task. The upper end holds for every larger friction.

    Raises
    ------
    InputError
        When contacts have no friction, or different coefficients, or a number is out of range.
    """
    require_grasp(grasp)
    task = task_for(task, grasp)
    base = common_friction(grasp.contacts)
    values: Sequence[float] = array("frictions", frictions, (None,)).tolist()
    factors = [number("frictions", value, above=0.0) / base for value in values]
    budget = "shared" if total else "per_finger"
    return tuple(_least_force(grasp.with_friction(factor), task, budget, rtol) for factor in factors)


def _least_force(grasp: Grasp, task: Task, budget: str | ForceBudget, rtol: float, seed: int = 0) -> Bounds:
    """Return the least use of a force budget that holds a task, ``1 / mu``; infinite where none is known to."""
    quality = mu(grasp, task, rtol, force_budget=budget, seed=seed)
    return quality.reciprocal().of_measure("force")


def common_friction(contacts: Sequence[ContactModel], field: str = "grasp.contacts") -> float:
    """Return the one friction coefficient of contacts; those without friction do not count.

    Raises
    ------
    InputError
        When there is none, or more than one; ``field`` is shown in the message.
    """
    coefficients = [model.coefficients for model in contacts if model.coefficients]
    found = sorted({values["friction"] for values in coefficients if "friction" in values})
    if not all("friction" in values for values in coefficients):
        names = ", ".join(sorted({name for values in coefficients for name in values}))
        raise InputError(field, f"coefficients called {names}", "contacts with one coefficient called friction")
    if not found:
        raise InputError(field, "contacts without friction", "contacts with one friction coefficient")
    if len(found) > 1:
        given = f"contacts with friction {' and '.join(f'{value:g}' for value in found)}"
        reason = f"what is held with {found[0]:g} at all of them is held with these too"
        raise InputError(field, given, f"one friction coefficient: {reason}")
    return float(found[0])
