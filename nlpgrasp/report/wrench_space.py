"""Shadows of the grasp's wrench set and of the task on planes of wrench space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import budget_from_dict
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.report.chosen_wrenches import LABELS
from nlpgrasp.solution import GraspSolution
from nlpgrasp.tasks import task_from_dict
from nlpgrasp.validation import FloatArray

ANGLES = np.linspace(0.0, 2.0 * np.pi, 145)


@dataclass(frozen=True)
class Shadow:
    """Outlines on one plane.

    Parameters
    ----------
    x_label, y_label : str
    grasp, task : (m, 2) array
        Outlines of G(B n K), and of the task times the certified lower bound.
    limit : float or None
        Where both end along the horizontal axis: on the plane that holds the weakest direction.
    """

    x_label: str
    y_label: str
    grasp: FloatArray
    task: FloatArray
    limit: float | None = None


def shadows(solution: GraspSolution) -> list[Shadow]:
    """Return the shadows on the planes of forces and of moments, and on one that holds the weakest direction."""
    grasp = solution.grasp
    if grasp is None:
        return []
    reachable = WrenchSet.of(grasp, budget_from_dict(solution.problem["force_budget"]))
    task, scale = task_from_dict(solution.problem["task"]), solution.mu.lower
    d, space = grasp.dimension, grasp.space
    labels = [f"{n} [{'N' if i < space else 'N m'}]" for i, n in enumerate(LABELS[d])]
    spatial = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
    pairs = spatial if d == 6 else [(0, 1), (0, 2), (1, 2)]
    lengths = np.ones(d)
    lengths[space:] = 1.0 / max(grasp.mean_arm, 1e-12)  # directions in the plane are spread evenly in these units

    def outlines(plane: FloatArray) -> tuple[FloatArray, FloatArray]:
        y = (np.cos(ANGLES)[:, None] * plane[0] + np.sin(ANGLES)[:, None] * plane[1]) * lengths
        return reachable.support(y)[1] @ plane.T, scale * task.support(y)[1] @ plane.T

    found = []
    y = solution.mu.worst_direction
    if y is not None and np.linalg.norm(y) > 0.0:
        found.append(_weakest(y / np.linalg.norm(y), lengths, outlines))
    for i, j in pairs:
        found.append(Shadow(labels[i], labels[j], *outlines(np.eye(d)[[i, j]])))
    return found


def _weakest(y: FloatArray, lengths: FloatArray, outlines: object) -> Shadow:
    """Return the shadow on a plane that holds the weakest direction: there the task touches the wrench set."""
    along = y / lengths
    along = along / np.linalg.norm(along)
    others = np.eye(len(y)) - np.outer(along, along)
    across = others[int(np.argmax(np.linalg.norm(others, axis=1)))]
    plane = np.stack([along, across / np.linalg.norm(across)])
    grasp, task = outlines(plane)  # type: ignore[operator]  # the function above
    return Shadow("along the weakest direction", "across it", grasp, task, float(np.max(task[:, 0])))
