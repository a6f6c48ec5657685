"""Weakest directions of a grasp against a task: local minimisers of the support ratio, by multistart descent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.containment import Containment, make_containment
from nlpgrasp.quality.force_closure import planar_facets, separating_direction, turned_to_task
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import (
    descend,
    minimise_l2_ratio,
    random_directions,
    select_separated,
)
from nlpgrasp.quality.sandwich import ResumableCertificate, Sandwich, tighten
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task

SLACK = 1.25  # factor above the least ratio up to which local minima are kept
KEEP = 64  # directions kept, at most
SEPARATION = 0.97  # cosine above which two directions count as one
DIFFERENT = 1.0 - 1e-5  # cosine above which two minimisers count as one
NEWTON_STEPS = 12
FRESH = 24  # random directions beside known ones
HULL_GAP, HULL_CELLS = 2e-3, 600  # relative gap of the certificate's polytope; facets used
MISSED, LOOK = 0.01, 0.03  # relative: error of descents that is tolerated; width of the certificate that checks it
NEWS = 1e-4  # relative error tolerated at kinks, where descents stop and the certificate's polytope is exact
BEGUN, FOLLOWED = 10, 40  # gradient steps; weakest directions that inverse iteration continues from


@dataclass(frozen=True)
class WeakestDirections:
    """Local minimisers of the support ratio ``phi_G / phi_A``.

    Parameters
    ----------
    value : float
        The least ratio found: an upper bound on mu, and nearly always mu itself.
    directions : (m, d) array
        Wrench-space directions, least first, each scaled so that ``phi_A = 1``.
    """

    value: float
    directions: FloatArray


@dataclass(frozen=True)
class DescentSettings:
    """Thoroughness of a search for weakest directions.

    Parameters
    ----------
    fresh : int
        Random directions.
    steps : int
        Of each descent.
    gap : float
        Relative: how near to certified the least ratio is where directions come from a polytope.
    """

    fresh: int
    steps: int = 12
    gap: float = HULL_GAP


THOROUGH, QUICK = DescentSettings(150), DescentSettings(60)


def weakest_directions(
    grasp: Grasp,
    task: Task,
    budget: ForceBudget,
    rng: np.random.Generator,
    known: FloatArray | None = None,
    descents: DescentSettings = THOROUGH,
) -> WeakestDirections:
    """Return the weakest directions of a grasp.

    Under the L2 budget they come from descents, in milliseconds. Descents stop at the kinks of other budgets' supports,
    and may miss a narrow minimum near a direction along which no force in the cones works and the task requires none:
    in both cases the directions come from the certificate's polytope.

    Parameters
    ----------
    grasp : Grasp
    task : Task
    budget : ForceBudget
    rng : numpy.random.Generator
    known : (m, d) array, optional
        Directions to start from as well, for example those of a nearby grasp.
    descents : DescentSettings
    """
    containment, proof = make_containment(WrenchSet.of(grasp, budget), task)
    if containment is None:  # the rank of the grasp map alone proves that mu is 0
        y = np.zeros((0, grasp.dimension)) if proof is None else scale_to_unit_support(task, proof[None, :])
        return WeakestDirections(0.0, y)
    separating = separating_direction(containment.wrenches) if isinstance(budget, L2Budget) else None
    # the ratio is infinite where the task requires nothing along a direction in which no force works
    can_descend = separating is None or np.isfinite(containment.ratio(separating[None])[0][0])
    if isinstance(budget, L2Budget) and can_descend:
        random = random_directions(descents.fresh, containment.rank, rng)
        start = [random, to_coordinates(containment, known), facet_directions(containment)]
        start += [] if separating is None else [separating[None]]
        directions, values = _descend_and_iterate(containment, np.concatenate(start), descents.steps)
    else:
        directions, values = _minimise_over_hull(containment, descents.gap)
    return _weakest(containment, task, directions, values)


def weakest_in_polytope(certificate: ResumableCertificate, value: float) -> WeakestDirections | None:
    """Return the weakest directions of a certificate's polytope, or None.

    None unless the least ratio is well below ``value``.
    """
    directions, values = _hull_directions(certificate.containment, certificate.sandwich)
    is_weaker = bool(np.min(values) < value * (1.0 - MISSED))
    return _weakest(certificate.containment, certificate.task, directions, values) if is_weaker else None


def _weakest(problem: Containment, task: Task, directions: FloatArray, values: FloatArray) -> WeakestDirections:
    """Return the weakest of some directions in a containment's coordinates, well separated."""
    order = np.argsort(values)
    order = order[values[order] <= SLACK * values[order[0]] + 1e-12]
    chosen = select_separated(directions, order, SEPARATION, KEEP)
    return WeakestDirections(float(values[chosen[0]]), scale_to_unit_support(task, directions[chosen] @ problem.matrix))


def facet_directions(problem: Containment) -> FloatArray:
    """Return directions near the facets of a planar cone of wrenches, (m, 3); none of other wrench sets."""
    if problem.rank != 3 or problem.wrenches.space != 2:
        return np.zeros((0, problem.rank))
    normals, is_facet = planar_facets(problem.wrenches.G[None], problem.wrenches.contacts)
    return turned_to_task(normals[0, is_facet[0]], problem.task, np.eye(3)).reshape(-1, 3)


def to_coordinates(problem: Containment, directions: FloatArray | None) -> FloatArray:
    """Return directions (m, d) in the coordinates of a task containment, (m', r), without vanishing ones."""
    if directions is None or not len(directions):
        return np.zeros((0, problem.rank))
    u = np.linalg.lstsq(problem.matrix.T, directions.T, rcond=None)[0].T
    size = np.linalg.norm(u, axis=1, keepdims=True)
    return np.asarray(u[size[:, 0] > 0.0] / size[size[:, 0] > 0.0])


def _descend_and_iterate(problem: Containment, start: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return weak directions and their ratios, by a few gradient steps followed by inverse iteration.

    The former are near the latter and not yet all the same: cuts around the weakest directions are what a step needs.
    """
    directions, values = descend(problem, start, BEGUN)
    weakest = np.argsort(values, kind="stable")[:FOLLOWED]
    refined, refined_values = minimise_l2_ratio(problem, directions[weakest], steps)
    return np.concatenate([refined, directions]), np.concatenate([refined_values, values])


def _minimise_over_hull(problem: Containment, gap: float) -> tuple[FloatArray, FloatArray]:
    """Return weak directions and their support ratios from the polytope of a new certificate."""
    return _hull_directions(problem, tighten(problem, gap))


def _hull_directions(problem: Containment, sandwich: Sandwich) -> tuple[FloatArray, FloatArray]:
    """Return the normals of a polytope's lowest facets, and their support ratios."""
    directions = sandwich.worst[None, :]
    if sandwich.hull is not None and problem.rank > 1:
        cells, _ = sandwich.hull.exceeded(SLACK * sandwich.upper, HULL_CELLS)
        directions = np.concatenate([directions, sandwich.hull.normals(cells)])
    return directions, problem.ratio(directions)[0]


def scale_to_unit_support(task: Task, y: FloatArray) -> FloatArray:
    """Return the directions (m, d) with a positive support of the task, scaled to ``phi_A = 1``."""
    reach = task.support(y)[0]
    return np.asarray(y[reach > 0.0] / reach[reach > 0.0][:, None])
