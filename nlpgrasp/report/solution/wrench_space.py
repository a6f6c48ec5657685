"""Projections of the wrench set and of the task onto planes of wrench space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.words import axis_labels
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task

ANGLES = np.linspace(0.0, 2.0 * np.pi, 145)


@dataclass(frozen=True)
class Shadow:
    """Projection of both sets onto one plane.

    Parameters
    ----------
    x_label, y_label : str
    grasp, task : (m, 2) array
        Outlines of G(B n K), and of the task times the certified lower bound.
    limit : float or None
        Largest wrench of the grasp along the weakest direction, on the plane that shows it.
    """

    x_label: str
    y_label: str
    grasp: FloatArray
    task: FloatArray
    limit: float | None = None


def shadows(solution: GraspSolution) -> list[Shadow]:
    """Return the projections onto the planes of forces and moments, and onto one with the weakest direction."""
    grasp = solution.grasp
    if grasp is None:
        return []
    reachable = WrenchSet.of(grasp, solution.budget)
    task, scale = solution.task, solution.mu.lower
    d = grasp.dimension
    labels = axis_labels(d)
    spatial = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
    pairs = spatial if d == 6 else [(0, 1), (0, 2), (1, 2)]
    found = []
    if solution.mu.worst_direction is not None and np.any(solution.mu.worst_direction):
        found.append(_weakest(solution.mu.worst_direction, reachable, task, scale))
    for i, j in pairs:
        plane = np.eye(d)[[i, j]]
        found.append(Shadow(labels[i], labels[j], *_outlines(plane, reachable, task, scale)))
    return found


def _outlines(plane: FloatArray, reachable: WrenchSet, task: Task, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the outlines of both sets' images under ``w -> plane w``: points that attain the support functions.

    Parameters
    ----------
    plane : (2, d) array
        Its rows need be neither orthogonal nor of unit length.
    """
    sizes = np.maximum(reachable.support(plane)[0], reachable.support(-plane)[0])
    evenly = plane / np.maximum(sizes, 1e-300)[:, None]  # even directions in the picture
    y = np.cos(ANGLES)[:, None] * evenly[0] + np.sin(ANGLES)[:, None] * evenly[1]
    return reachable.support(y)[1] @ plane.T, scale * task.support(y)[1] @ plane.T


def _weakest(y: FloatArray, reachable: WrenchSet, task: Task, scale: float) -> Shadow:
    """Return the projection along the weakest direction, in shares of the producible wrench: the sets nearly touch."""
    limit = float(reachable.support(y[None, :])[0][0])
    along = y / limit if limit > 0.0 else y / np.linalg.norm(y)
    sizes = np.maximum(reachable.support(np.eye(len(y)))[0], 1e-300)
    across = (np.eye(len(y)) / sizes[:, None])[int(np.argmin(np.abs(along) * sizes))]
    plane = np.stack([along, across])
    grasp, shown = _outlines(plane, reachable, task, scale)
    return Shadow("along the weakest direction", "across it", grasp, shown, float(np.max(grasp[:, 0])))
