"""Cutting planes: weakest directions of a candidate, for which the program enforces support inequalities.

They are computed at a candidate, selected for the slots of the program, and passed to it as parameters.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import SLOTS
from nlpgrasp.quality.containment import Containment, make_containment
from nlpgrasp.quality.ratio_minimisation import (
    descend,
    minimise_l2_ratio,
    principal_curvatures,
    random_directions,
    refine_by_newton,
    select_separated,
)
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.tight_wrenches import tight_wrenches
from nlpgrasp.quality.weakest_directions import (
    BEGUN,
    DIFFERENT,
    FRESH,
    KEEP,
    LOOK,
    NEWS,
    NEWTON_STEPS,
    SEPARATION,
    SLACK,
    THOROUGH,
    DescentSettings,
    WeakestDirections,
    facet_directions,
    scale_to_unit_support,
    to_coordinates,
    weakest_directions,
    weakest_in_polytope,
)

WIDEST = 0.1  # radians: largest angle between a minimiser and directions around it
SAME = 1.0 - 1e-7  # cosine above which a direction counts as a known cut


def weakest_directions_of(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    rng: np.random.Generator,
    known: FloatArray | None = None,
    descents: DescentSettings = THOROUGH,
) -> WeakestDirections:
    """Return the weakest directions of a candidate against the problem's task; see ``weakest_directions``."""
    return weakest_directions(
        compiled.grasp(candidate), compiled.problem.task, compiled.budget(candidate), rng, known, descents
    )


def exact_minimisers(
    compiled: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator, directions: FloatArray
) -> WeakestDirections:
    """Return the weakest directions of a candidate as exact local minimisers of the support ratio.

    Minimisers close to each other are told apart. Descents begin from ``directions``, such as those of a candidate
    nearby, and from a few random ones.
    """
    problem, _ = make_containment(compiled.wrench_set(candidate), compiled.problem.task)
    if problem is None:
        return WeakestDirections(0.0, directions[:0])
    if isinstance(compiled.budget(candidate), L2Budget):
        known = [to_coordinates(problem, directions), facet_directions(problem)]
        y, values = minimise_l2_ratio(
            problem, np.concatenate([*known, random_directions(FRESH, problem.rank, rng)]), BEGUN
        )
        order = np.argsort(values)
        chosen = select_separated(y, order[values[order] <= SLACK * values[order[0]]], DIFFERENT, KEEP)
        y, values = refine_by_newton(problem, y[chosen], NEWTON_STEPS)
    else:
        y, values = _minimisers_at_kinks(problem, to_coordinates(problem, directions), rng)
    order = np.argsort(values)
    chosen = select_separated(y, order, DIFFERENT, KEEP)
    return WeakestDirections(
        float(values[chosen[0]]), scale_to_unit_support(compiled.problem.task, y[chosen] @ problem.matrix)
    )


def _minimisers_at_kinks(
    problem: Containment, known: FloatArray, rng: np.random.Generator, fresh: int = 8, most: int = 24
) -> tuple[FloatArray, FloatArray]:
    """Return local minimisers of the support ratio of a budget other than L2, and their ratios."""
    y, values = descend(problem, np.concatenate([known, random_directions(FRESH, problem.rank, rng)]), BEGUN)
    near = select_separated(known, np.argsort(problem.ratio(known)[0]), SEPARATION, most)
    new = select_separated(y, np.argsort(values), SEPARATION, fresh)
    tight = tight_wrenches(problem, np.concatenate([known[near], y[new]]))
    return (y, values) if not len(tight) else (tight.directions, tight.ratios)


def directions_around(
    compiled: CompiledProblem, candidate: GraspCandidate, minimisers: FloatArray, excess: float = 1e-7
) -> FloatArray:
    """Return minimisers of the support ratio (m, d), and directions around the least of them, with ``phi_A = 1``.

    The latter are along the principal axes of the ratio, where it is higher by a relative ``excess``: where it is
    nearly flat, all of these bind.
    """
    problem, _ = make_containment(compiled.wrench_set(candidate), compiled.problem.task)
    if problem is None or not len(minimisers) or not isinstance(compiled.budget(candidate), L2Budget):
        return minimisers
    u = to_coordinates(problem, minimisers)
    ratios, gradient = problem.ratio(u)
    axes, curvatures = principal_curvatures(problem, u, gradient)
    angles = np.minimum(np.sqrt(2.0 * excess * np.abs(ratios)[:, None] / curvatures), WIDEST)
    least = ratios <= (1.0 + 100.0 * excess) * np.min(ratios)
    tilts = (angles[..., None] * axes)[least]
    tilted = np.concatenate([u[least, None] + tilts, u[least, None] - tilts], axis=1).reshape(-1, problem.rank)
    around = scale_to_unit_support(compiled.problem.task, tilted @ problem.matrix)
    return np.concatenate([minimisers, around])


def missed_directions(
    compiled: CompiledProblem, candidate: GraspCandidate, value: float
) -> tuple[WeakestDirections | None, ResumableCertificate | None]:
    """Return weak directions that descents missed, and a certificate of the grasp; each may be None.

    The support ratio along them is below the known least ``value``. Descents miss narrow minima far from their initial
    directions; a certificate's polytope does not. Budgets other than the L2 budget have no such certificate here:
    descents are repeated, and the second value is None.
    """
    budget = compiled.budget(candidate)
    if value <= 0.0:
        return None, None
    if not isinstance(budget, L2Budget):
        weakest = weakest_directions_of(compiled, candidate, np.random.default_rng(0))
        return (weakest if weakest.value < value * (1.0 - NEWS) else None), None
    certificate = ResumableCertificate.of(compiled.grasp(candidate), compiled.problem.task, budget, LOOK)
    return (None if certificate is None else weakest_in_polytope(certificate, value)), certificate


def nearest_to_binding(
    compiled: CompiledProblem, candidate: GraspCandidate, cuts: FloatArray, most: int = SLOTS
) -> FloatArray:
    """Return the cuts (m, d) closest to binding at a candidate, at most ``most``."""
    if len(cuts) <= most:
        return cuts
    support = compiled.wrench_set(candidate).support(cuts)[0]
    return cuts[np.sort(np.argsort(support, kind="stable")[:most])]


def append_new(compiled: CompiledProblem, cuts: FloatArray, directions: FloatArray) -> FloatArray:
    """Return cuts (m, d) with the new ones among directions (n, d) appended."""
    return np.concatenate([cuts, directions[new_directions(compiled, cuts, directions)]])


def new_directions(compiled: CompiledProblem, cuts: FloatArray, directions: FloatArray) -> BoolArray:
    """Return the mask of directions (n, d) that equal none of the cuts (m, d) in solver units."""
    a, b = cuts / compiled.scaling.wrench, directions / compiled.scaling.wrench
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(np.max(b @ a.T, axis=1) < SAME)


def parameters_without_cuts(compiled: CompiledProblem, candidate: GraspCandidate) -> FloatArray:
    """Return the program's parameters (q,) without cuts, so that only the placement is constrained."""
    no_cuts = np.zeros((0, compiled.problem.dimension))
    return cut_parameters(compiled, candidate, no_cuts, compiled.cutting_planes.slots)


def cut_parameters(compiled: CompiledProblem, candidate: GraspCandidate, cuts: FloatArray, slots: int) -> FloatArray:
    """Return a program's parameters (q,) for cuts (m, d) with ``phi_A = 1``, padded with zeros to its slots.

    Without slots the parameters are those of faces and of links alone. Clearances of links are
    linearised at the candidate.
    """
    faces = face_parameters(compiled.problem, candidate.faces)
    rows = compiled.link_rows
    links = np.zeros(0) if rows is None else rows.parameters(candidate.hand)
    if not slots:
        return np.concatenate([faces, links])
    directions = np.zeros((slots, compiled.problem.dimension))
    directions[: len(cuts)] = cuts
    reach = np.zeros(slots)
    reach[: len(cuts)] = 1.0
    return np.concatenate([directions.ravel(), reach, faces, links])
