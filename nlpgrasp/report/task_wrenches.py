"""Task wrenches of a report with their finger forces, and projections of the wrench set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import COMPONENTS, FORCE_UNIT, SMALL, axis_labels, format_number, typeset, unit_of
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import Bounds, finger_forces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task

MOST_WRENCHES = 25  # most wrenches
OUTLINE_ANGLES = np.linspace(0.0, 2.0 * np.pi, 145)  # radians, directions of an outline's points


@dataclass(frozen=True)
class ChosenWrench:
    """Wrench of the unscaled task, with the least finger forces that produce it.

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


def choose_wrenches(solution: GraspSolution) -> list[ChosenWrench]:
    """Return the hardest and representative boundary wrenches of the task that the fingers can produce."""
    grasp = solution.grasp
    if grasp is None or not solution.is_certified:
        return []
    task = solution.task
    wrenches, names = [], []
    if solution.mu.worst_direction is not None:
        wrenches.append(task.support(solution.mu.worst_direction[None, :])[1][0])
        names.append("Hardest")
    for i, wrench in enumerate(task.ends()[: MOST_WRENCHES - len(wrenches)]):
        wrenches.append(wrench)
        names.append(f"End {i + 1}")
    scale = solution.mu.lower  # certified within one unit of the budget; forces scale in proportion
    solved = finger_forces(grasp, scale * np.array(wrenches), force_budget=solution.budget)
    return [
        ChosenWrench(
            f"{name}: {describe_wrench_by_axis(w, grasp.mean_arm)}",
            w,
            grasp.contact_wrenches(x)[:, : grasp.space] / scale,
        )
        for name, w, x, feasible in zip(names, wrenches, solved.forces, solved.feasible, strict=True)
        if feasible
    ]


@dataclass(frozen=True)
class FingerForce:
    """Force of one finger as text, with its size relative to the largest force.

    Parameters
    ----------
    words : str
    share : float
        Force over the largest one in any of the wrenches.
    """

    words: str
    share: float


def finger_forces_of(grasp: Grasp, chosen: Sequence[ChosenWrench]) -> list[list[FingerForce]]:
    """Return the force of each finger for each wrench, as normal and tangential components."""
    largest = max((float(np.max(np.linalg.norm(wrench.forces, axis=1))) for wrench in chosen), default=0.0) or 1.0
    forces_by_wrench = []
    for wrench in chosen:
        normal_forces = np.sum(wrench.forces * grasp.normals, axis=1)
        tangential_forces = np.linalg.norm(wrench.forces - normal_forces[:, None] * grasp.normals, axis=1)
        relative_sizes = np.linalg.norm(wrench.forces, axis=1) / largest
        zero_force = 1e-4 * largest
        normal, tangential = (
            [format_number(force, 3, zero_force) for force in forces] for forces in (normal_forces, tangential_forces)
        )
        forces_by_wrench.append(
            [
                FingerForce(typeset(f"normal {n} N, tangential {t} N"), float(size))
                for n, t, size in zip(normal, tangential, relative_sizes, strict=True)
            ]
        )
    return forces_by_wrench


def describe_wrench_by_axis(wrench: FloatArray, length: float) -> str:
    """Return a wrench (d,) as text of its significant components, such as ``0.3 N along x, 0.02 N m about z``.

    Moments are compared after division by the length, metres.
    """
    units = [unit_of(name) for name in COMPONENTS[len(wrench)]]
    weight = np.abs(wrench) / np.where([unit == FORCE_UNIT for unit in units], 1.0, length)
    parts = [
        f"{format_number(abs(v))} {unit} {'along' if unit == FORCE_UNIT else 'about'} "
        f"{'-' if v < 0.0 else ''}{name[-1]}"
        for name, unit, v, w in zip(COMPONENTS[len(wrench)], units, wrench.tolist(), weight, strict=True)
        if w > SMALL * np.max(weight)
    ]
    return typeset(", ".join(parts) or "nothing")


@dataclass(frozen=True)
class WrenchProjection:
    """Projection of the grasp wrench set and of the task onto one plane.

    Parameters
    ----------
    x_label, y_label : str
    grasp, task : (m, 2) array
        Outlines of G(B ∩ K), and of the task times the certified lower bound.
    limit : float or None
        Largest wrench of the grasp along the weakest direction, on the plane that shows it.
    """

    x_label: str
    y_label: str
    grasp: FloatArray
    task: FloatArray
    limit: float | None = None


def wrench_projections(grasp: Grasp, task: Task, mu: Bounds, budget: str | ForceBudget) -> list[WrenchProjection]:
    """Return the projections onto pairs of force and moment axes, and onto a plane with the weakest direction."""
    wrench_set = WrenchSet.of(grasp, budget)
    scale, d = mu.lower, grasp.dimension
    labels = axis_labels(d)
    spatial = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
    pairs = spatial if d == 6 else [(0, 1), (0, 2), (1, 2)]
    projections = []
    if mu.worst_direction is not None and np.any(mu.worst_direction):
        projections.append(_weakest_projection(mu.worst_direction, wrench_set, task, scale))
    for i, j in pairs:
        plane = np.eye(d)[[i, j]]
        projections.append(WrenchProjection(labels[i], labels[j], *_outlines(plane, wrench_set, task, scale)))
    return projections


def solution_projections(solution: GraspSolution) -> list[WrenchProjection]:
    """Return the projections of a solution's wrench set and task; none without a grasp."""
    if solution.grasp is None:
        return []
    return wrench_projections(solution.grasp, solution.task, solution.mu, solution.budget)


def _outlines(plane: FloatArray, wrench_set: WrenchSet, task: Task, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the outlines of wrench set and task projected by ``w -> plane w``, as points that attain the support.

    Parameters
    ----------
    plane : (2, d) array
        Its rows need be neither orthogonal nor of unit length.
    """
    sizes = np.maximum(wrench_set.support(plane)[0], wrench_set.support(-plane)[0])
    scaled_plane = plane / np.maximum(sizes, 1e-300)[:, None]  # even directions in the picture
    directions = np.cos(OUTLINE_ANGLES)[:, None] * scaled_plane[0] + np.sin(OUTLINE_ANGLES)[:, None] * scaled_plane[1]
    return wrench_set.support(directions)[1] @ plane.T, scale * task.support(directions)[1] @ plane.T


def _weakest_projection(direction: FloatArray, wrench_set: WrenchSet, task: Task, scale: float) -> WrenchProjection:
    """Return the projection onto a plane with the weakest direction, where task and wrench set nearly touch."""
    limit = float(wrench_set.support(direction[None, :])[0][0])
    along = direction / limit if limit > 0.0 else direction / np.linalg.norm(direction)
    sizes = np.maximum(wrench_set.support(np.eye(len(direction)))[0], 1e-300)
    across = (np.eye(len(direction)) / sizes[:, None])[int(np.argmin(np.abs(along) * sizes))]
    plane = np.stack([along, across])
    grasp, scaled_task = _outlines(plane, wrench_set, task, scale)
    return WrenchProjection("along the weakest direction", "across it", grasp, scaled_task, float(np.max(grasp[:, 0])))
