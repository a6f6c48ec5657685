"""Task wrenches of a report with their finger forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import rounded, typeset
from nlpgrasp.common.shown.words import COMPONENTS, FORCE_UNIT, SMALL, unit_of
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import finger_forces
from nlpgrasp.solution.solution import GraspSolution

MOST = 25  # most wrenches


@dataclass(frozen=True)
class ChosenWrench:
    """A wrench of the task at full size, with the least finger forces that produce it.

    Parameters
    ----------
    label : str
        Description.
    wrench : (d,) array
        Newtons and newton-metres.
    forces : (k, space) array
        Body frame, newtons.
    """

    label: str
    wrench: FloatArray
    forces: FloatArray


def chosen_wrenches(solution: GraspSolution) -> list[ChosenWrench]:
    """Return the hardest wrench of the task and the ends of its semi-axes, as far as they can be produced."""
    grasp = solution.grasp
    if grasp is None or not solution.is_certified:
        return []
    task = solution.task
    wrenches, names = [], []
    if solution.mu.worst_direction is not None:
        wrenches.append(task.support(solution.mu.worst_direction[None, :])[1][0])
        names.append("Hardest")
    for i, wrench in enumerate(task.ends()[: MOST - len(wrenches)]):
        wrenches.append(wrench)
        names.append(f"End {i + 1}")
    share = solution.mu.lower  # certified within one unit of the budget; forces scale in proportion
    found = finger_forces(grasp, share * np.array(wrenches), force_budget=solution.budget)
    return [
        ChosenWrench(f"{name}: {pushed(w, grasp.mean_arm)}", w, grasp.contact_wrenches(x)[:, : grasp.space] / share)
        for name, w, x, feasible in zip(names, wrenches, found.forces, found.feasible, strict=True)
        if feasible
    ]


@dataclass(frozen=True)
class FingerForce:
    """Force of one finger, as text.

    Parameters
    ----------
    words : str
    share : float
        Force over the largest one in any of the wrenches.
    """

    words: str
    share: float


def finger_forces_of(grasp: Grasp, chosen: Sequence[ChosenWrench]) -> list[list[FingerForce]]:
    """Return the normal and tangential force of each finger, for each wrench."""
    largest = max((float(np.max(np.linalg.norm(c.forces, axis=1))) for c in chosen), default=0.0) or 1.0
    found = []
    for c in chosen:
        pressing = np.sum(c.forces * grasp.normals, axis=1)
        rubbing = np.linalg.norm(c.forces - pressing[:, None] * grasp.normals, axis=1)
        sizes = np.linalg.norm(c.forces, axis=1) / largest
        least = 1e-4 * largest
        found.append(
            [
                FingerForce(
                    typeset(f"normal {rounded(p, 3, least)} N, tangential {rounded(t, 3, least)} N"), float(share)
                )
                for p, t, share in zip(pressing, rubbing, sizes, strict=True)
            ]
        )
    return found


def pushed(wrench: FloatArray, length: float) -> str:
    """Return a wrench (d,) as text of its significant components, such as ``0.3 N along x, 0.02 N m about z``.

    Moments are compared after division by the length, metres.
    """
    units = [unit_of(name) for name in COMPONENTS[len(wrench)]]
    weight = np.abs(wrench) / np.where([unit == FORCE_UNIT for unit in units], 1.0, length)
    parts = [
        f"{rounded(abs(v))} {unit} {'along' if unit == FORCE_UNIT else 'about'} {'-' if v < 0.0 else ''}{name[-1]}"
        for name, unit, v, w in zip(COMPONENTS[len(wrench)], units, wrench.tolist(), weight, strict=True)
        if w > SMALL * np.max(weight)
    ]
    return typeset(", ".join(parts) or "nothing")
