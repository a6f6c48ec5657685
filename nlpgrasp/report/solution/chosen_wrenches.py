"""The task wrenches that a report shows finger forces for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.words import wrench_words
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import finger_forces
from nlpgrasp.solution.solution import GraspSolution

MOST = 25  # wrenches


@dataclass(frozen=True)
class ChosenWrench:
    """A wrench of the task, scaled by the certified lower bound, and the finger forces that produce it.

    Parameters
    ----------
    label : str
        In words.
    wrench : (d,) array
    forces : (k, space) array
        Body frame.
    """

    label: str
    wrench: FloatArray
    forces: FloatArray


def chosen_wrenches(solution: GraspSolution) -> list[ChosenWrench]:
    """Return the hardest wrench of the task and the ends of its semi-axes; those that fingers can produce."""
    grasp = solution.grasp
    if grasp is None or not solution.success:
        return []
    task = solution.task
    wrenches, names = [], []
    if solution.mu.worst_direction is not None:
        wrenches.append(task.support(solution.mu.worst_direction[None, :])[1][0])
        names.append("hardest wrench")
    for i, wrench in enumerate(task.ends()[: MOST - len(wrenches)]):
        wrenches.append(wrench)
        names.append(f"task wrench {i + 1}")
    scaled = solution.mu.lower * np.array(wrenches)
    found = finger_forces(grasp, scaled, force_budget=solution.budget)
    return [
        ChosenWrench(f"{name}: {wrench_words(w)}", w, grasp.contact_wrenches(x)[:, : grasp.space])
        for name, w, x, feasible in zip(names, scaled, found.forces, found.feasible, strict=True)
        if feasible
    ]


def force_words(grasp: Grasp, forces: FloatArray) -> list[str]:
    """Return for each finger how hard it presses and how hard it rubs."""
    pressing = np.sum(forces * grasp.normals, axis=1)
    rubbing = np.linalg.norm(forces - pressing[:, None] * grasp.normals, axis=1)
    both = enumerate(zip(pressing, rubbing, strict=True))
    return [f"finger {i}: {p:.3g} N normal, {t:.3g} N tangential" for i, (p, t) in both]
