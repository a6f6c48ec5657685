"""Sensitivity of a grasp: the least force that its fingers feel of a wrench of the task's size (Section 4).

Between fingertips of equal stiffness a wrench w on the body changes the finger forces by the least ones, ``x = G^+ w``.
Wrenches that change them by at most 1 N, all fingers together, are the ellipsoid ``G B_1`` of (3.2-2). It is within
``alpha A`` if ``|G^T y| <= alpha phi_A(y)`` for all y, so that outside of alpha A every wrench is felt by 1 N, and

    ``felt = 1 / alpha = min over w on the boundary of A of |G^+ w| = min_y phi_A(y) / |G^T y|``.

mu asks for the task inside the forces, sensitivity for the forces inside the task: every added contact takes a part of
the wrench, so that the others feel less, and fewer contacts win. The task's mean wrench is felt all the time; A is the
task about its centre, with ``phi_A(y) = (phi(y) + phi(-y)) / 2``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, integer
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.tasks import Task


@dataclass(frozen=True)
class Sensitivity:
    """Least change of the finger forces by a wrench of the task's size.

    Parameters
    ----------
    felt : float
        Size of all force changes together, newtons; 0 if contacts bear some wrench of the task without any.
    wrench : (d,) array
        The wrench of the task that is felt least, N and N m, about the grasp's torque origin, without the task's mean.
    fingers : (k,) array
        What each finger feels of it, newtons.
    """

    felt: float
    wrench: FloatArray
    fingers: FloatArray

    def share_felt(self, resolution: float) -> float:
        """Return the least share of the task that fingers feel which resolve force changes of so many newtons."""
        return resolution / self.felt if self.felt > 0.0 else np.inf

    def to_dict(self) -> Json:
        """Return the values as JSON data."""
        return {"felt": self.felt, "wrench": self.wrench.tolist(), "fingers": self.fingers.tolist()}

    def __str__(self) -> str:
        fingers = ", ".join(f"{force:.3g}" for force in self.fingers)
        return f"fingers feel at least {self.felt:.4g} N of a wrench of the task's size (of the least felt {fingers} N)"


def sensitivity(grasp: Grasp, task: Task, starts: int = 30, most_corners: int = 400) -> Sensitivity:
    """Return the least force that a grasp's fingers feel of a wrench of the task's size.

    By descents from ``starts`` directions, of polytopes of few corners from all facets. Of an ellipsoid with the
    semi-axes L it is the least singular value of ``G^+ L``.

    Parameters
    ----------
    grasp : Grasp
        Whose fingers feel the task's wrenches.
    task : Task
        About its torque origin, or the grasp's.
    starts, most_corners : int
        Descents; largest number of a polytope's corners and their mirror images whose facets are computed.

    Raises
    ------
    InputError
        For a task of one wrench alone, which has no size.
    """
    require_grasp(grasp)
    task, starts = task_for(task, grasp), integer("starts", starts, at_least=1)
    rng = np.random.default_rng(0)

    def half_width(y: FloatArray) -> tuple[float, FloatArray]:
        values, wrenches = task.support(np.array([y, -y]))
        return 0.5 * float(np.sum(values)), 0.5 * (wrenches[0] - wrenches[1])

    # the wrenches of the task about its centre span a basis of r wrenches, in units of their sizes
    units = np.array([half_width(axis)[0] for axis in np.eye(task.dimension)])
    units[units <= 0.0] = 1.0
    directions = random_directions(20 * task.dimension, task.dimension, rng) / units
    spread = np.array([half_width(y)[1] for y in directions])
    sizes, axes = np.linalg.svd(spread / units)[1:]
    basis = axes[: len(sizes)][sizes > 1e-9 * max(sizes[0], 1e-300)] * units  # (r, d)
    if not sizes[0] > 0.0:
        raise InputError("task", task, "a task of more than one wrench")
    dual = basis / units**2  # of the basis: directions y = z dual have <y, w> = <z, v> for wrenches w = v basis
    least_forces = np.linalg.pinv(grasp.G)
    responses = least_forces @ basis.T  # finger forces (n, r) of unit wrenches
    missed = basis.T - grasp.G @ responses
    if np.max(np.abs(missed / units[:, None])) > 1e-9 or np.linalg.svd(responses)[1][-1] <= 0.0:
        y = np.linalg.svd((missed / units[:, None]).T)[2][0] / units
        return Sensitivity(0.0, half_width(y)[1], np.zeros(len(grasp)))
    felt_by_one = np.linalg.inv(responses.T @ responses)

    corners = list[FloatArray]()  # wrenches of the task's boundary, as r coordinates, that were found on the way

    def ratio(z: FloatArray) -> tuple[float, FloatArray]:
        reach, wrench = half_width(z @ dual)
        corners.append(dual @ wrench)
        norm = float(np.sqrt(z @ felt_by_one @ z))
        return reach / norm, corners[-1] / norm - reach * (felt_by_one @ z) / norm**3

    seeds = random_directions(starts, len(basis), rng)
    found = [minimize(ratio, z, jac=True, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-12}).x for z in seeds]
    # a polytope's ratio is least at the normals of its facets, between which descents end at kinks
    sides = np.unique(np.round([*corners, *(-wrench for wrench in corners)], 9), axis=0)
    if len(basis) > 1 and len(sides) <= most_corners:
        hull = ConvexHull(sides, qhull_options="QJ")
        found += list(hull.equations[:, :-1])
    best = min(found, key=lambda z: ratio(z)[0])
    felt = ratio(best)[0]
    wrench = felt * (felt_by_one @ best) / np.sqrt(best @ felt_by_one @ best) @ basis
    forces = least_forces @ wrench
    parts = component_slices(grasp.contacts, grasp.space)
    return Sensitivity(felt, wrench, np.array([np.linalg.norm(forces[part]) for part in parts]))
