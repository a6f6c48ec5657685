"""Least friction with which a task is held, and least force at each friction, by certificates.

The force domains grow with friction, ``K(f)`` is in ``K(g)`` for f <= g, and with them the wrench set: what is proved
at one friction holds for every larger one, and what is refuted at one is refuted for every smaller one. So bisection
between certificates brackets the least friction, and both ends are proved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import array, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu
from nlpgrasp.tasks import Task


def critical_friction(
    grasp: Grasp,
    task: Task,
    *,
    finger_force: float | None = None,
    total: float | None = None,
    rtol: float = 0.02,
    largest: float = 10.0,
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
        Relative width of the interval.
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
        When contacts have no friction, or different coefficients, or both limits are given.
    """
    require_grasp(grasp)
    task = task_for(task, grasp)
    if finger_force is not None and total is not None:
        raise InputError("total", total, "one of finger_force and total")
    limit = np.inf
    if finger_force is not None:
        limit = number("finger_force", finger_force, above=0.0)
    elif total is not None:
        limit = number("total", total, above=0.0)
    budget = "shared" if total is not None else "per_finger"
    rtol = number("rtol", rtol, above=0.0)
    base = _friction(grasp)
    least, most = 0.0, np.inf  # refuted, proved
    trial = min(base, largest)
    while most > (1.0 + rtol) * least:
        verdict = _is_held(_with_friction(grasp, trial / base), task, budget, 1.0 / limit)
        if verdict is None:
            break  # closer than certificates tell apart
        if verdict:
            most = trial
        else:
            least = trial
        if least >= largest or most <= 1e-3 * base:
            break
        trial = np.sqrt(least * most) if 0.0 < least < most < np.inf else (0.5 * most if least == 0.0 else 2.0 * least)
        trial = float(min(trial, largest))
    return Bounds(float(least), float(most), kind="friction")


def force_curve(
    grasp: Grasp, task: Task, frictions: ArrayLike, *, total: bool = False, rtol: float = 0.01
) -> tuple[Bounds, ...]:
    """Return the least normal force, newtons, with which a task is held at each friction coefficient.

    Parameters
    ----------
    grasp : Grasp
        As for ``critical_friction``.
    task : Task
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
    """
    require_grasp(grasp)
    task = task_for(task, grasp)
    base = _friction(grasp)
    values: Sequence[float] = array("frictions", frictions, (None,)).tolist()
    curve = []
    for value in values:
        friction = number("frictions", value, above=0.0)
        budget = "shared" if total else "per_finger"
        quality = mu(_with_friction(grasp, friction / base), task, rtol, force_budget=budget)
        upper = 1.0 / quality.lower if quality.lower > 0.0 else np.inf
        curve.append(Bounds(1.0 / quality.upper if quality.upper > 0.0 else np.inf, upper, kind="force"))
    return tuple(curve)


def _is_held(grasp: Grasp, task: Task, budget: str, least: float) -> bool | None:
    """Return whether certificates prove that mu is above ``least``, or refute it; None if they do neither."""
    for rtol in (0.3, 0.03, 0.003):
        quality = mu(grasp, task, rtol, force_budget=budget)
        if quality.lower > 0.0 and quality.lower >= least:
            return True
        if quality.upper < least or quality.upper == 0.0:
            return False
    return None


def _friction(grasp: Grasp) -> float:
    """Return the one friction coefficient of a grasp's contacts."""
    found = {c.coefficients["friction"] for c in grasp.contacts if "friction" in c.coefficients}
    if len(found) != 1:
        given = "no friction" if not found else f"friction {', '.join(f'{f:g}' for f in sorted(found))}"
        raise InputError("grasp.contacts", given, "contacts with one friction coefficient")
    return found.pop()


def _with_friction(grasp: Grasp, factor: float) -> Grasp:
    models = [contact.with_friction(factor) for contact in grasp.contacts]
    return Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents, grasp.force_unit)
