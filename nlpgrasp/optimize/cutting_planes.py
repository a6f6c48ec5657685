"""Cutting planes: weakest directions of a candidate, for which the program enforces support inequalities.

They are computed at a candidate, selected for the slots of the program, and passed to it as parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.budgets import L2Budget, SharedJointTorqueLimits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.nlp import face_parameters
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.ratio_minimisation import (
    descend,
    minimise_l2_ratio,
    random_directions,
    refine_by_newton,
    select_separated,
)
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.weakest_directions import (
    BEGUN,
    DIFFERENT,
    FRESH,
    KEEP,
    LOOK,
    NEWS,
    NEWTON_STEPS,
    SLACK,
    THOROUGH,
    DescentSettings,
    WeakestDirections,
    scale_to_unit_support,
    to_coordinates,
    weakest_directions,
    weakest_in_polytope,
)

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
    """Return the weakest directions of a candidate as exact local minimisers, also where these are close together.

    Descents begin from ``directions``, such as those of a candidate nearby, and from a few random ones.
    """
    problem, _ = make_containment(compiled.wrench_set(candidate), compiled.problem.task)
    if problem is None:
        return WeakestDirections(0.0, directions[:0])
    start = np.concatenate([to_coordinates(problem, directions), random_directions(FRESH, problem.rank, rng)])
    squared = isinstance(compiled.budget(candidate), L2Budget)
    y, values = minimise_l2_ratio(problem, start, BEGUN) if squared else descend(problem, start, BEGUN)
    order = np.argsort(values)
    chosen = select_separated(y, order[values[order] <= SLACK * values[order[0]]], DIFFERENT, KEEP)
    y, values = refine_by_newton(problem, y[chosen], NEWTON_STEPS)
    order = np.argsort(values)
    chosen = select_separated(y, order, DIFFERENT, KEEP)
    return WeakestDirections(
        float(values[chosen[0]]), scale_to_unit_support(compiled.problem.task, y[chosen] @ problem.matrix)
    )


def missed_directions(
    compiled: CompiledProblem, candidate: GraspCandidate, value: float
) -> tuple[WeakestDirections | None, ResumableCertificate | None]:
    """Return directions below the known least value that descents missed, and the certificate; each may be None.

    Descents miss narrow minima far from their initial directions; a certificate's polytope does not. Budgets other than
    the L2 budget have no such certificate here: descents are repeated, and the second value is None.
    """
    budget = compiled.budget(candidate)
    if value <= 0.0:
        return None, None
    if not isinstance(budget, L2Budget):
        weakest = weakest_directions_of(compiled, candidate, np.random.default_rng(0))
        return (weakest if weakest.value < value * (1.0 - NEWS) else None), None
    certificate = ResumableCertificate.of(compiled.grasp(candidate), compiled.problem.task, budget, LOOK)
    return (None if certificate is None else weakest_in_polytope(certificate, value)), certificate


def nearest_to_binding(compiled: CompiledProblem, candidate: GraspCandidate, cuts: FloatArray) -> FloatArray:
    """Return the cuts (m, d) that are nearest to binding at a candidate, at most one for each slot of the program."""
    if len(cuts) <= compiled.cutting_planes.slots:
        return cuts
    support = compiled.wrench_set(candidate).support(cuts)[0]
    return cuts[np.sort(np.argsort(support, kind="stable")[: compiled.cutting_planes.slots])]


def append_new(compiled: CompiledProblem, cuts: FloatArray, directions: FloatArray) -> FloatArray:
    """Return cuts (m, d) followed by those of the directions (n, d) that are not among them."""
    return np.concatenate([cuts, directions[new_directions(compiled, cuts, directions)]])


def new_directions(compiled: CompiledProblem, cuts: FloatArray, directions: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of directions (n, d) that are not among cuts (m, d), compared in solver units."""
    a, b = cuts / compiled.scaling.wrench, directions / compiled.scaling.wrench
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(np.max(b @ a.T, axis=1) < SAME)


def parameters_without_cuts(compiled: CompiledProblem, candidate: GraspCandidate) -> FloatArray:
    """Return the program's parameters (q,) without cuts: for the placement constraints alone."""
    return piece_parameters(compiled, candidate, np.zeros((0, compiled.problem.dimension)))


def piece_parameters(compiled: CompiledProblem, candidate: GraspCandidate, cuts: FloatArray) -> FloatArray:
    """Return the program's parameters (q,) for cuts (m, d), with the contact whose support is largest along each."""
    return slot_parameters(
        compiled, candidate.faces, cuts, compiled.cutting_planes.pieces(compiled.grasp(candidate), cuts)
    )


def slot_parameters(
    compiled: CompiledProblem, faces: tuple[str, ...], cuts: FloatArray, pieces: FloatArray | None = None
) -> FloatArray:
    """Return the program's parameters (q,) for cuts with ``phi_A = 1``; the other slots are empty.

    Parameters
    ----------
    compiled : CompiledProblem
    faces : tuple of k str
    cuts : (m, d) array
    pieces : (m, k) array, optional
        Supports of single contacts along the cuts, where the program takes the largest of them.
    """
    if compiled.problem.budget.follows_hand:  # such a program has no cuts
        return face_parameters(compiled.problem, faces)
    slots = compiled.cutting_planes.slots
    directions = np.zeros((slots, compiled.problem.dimension))
    directions[: len(cuts)] = cuts
    reach = np.zeros(slots)
    reach[: len(cuts)] = 1.0
    weights = np.zeros(0)
    if pieces is not None:
        weights = np.zeros((slots, pieces.shape[1]))
        weights[np.arange(len(cuts)), np.argmax(pieces, axis=1)] = 1.0
    return np.concatenate([directions.ravel(), reach, weights.ravel(), face_parameters(compiled.problem, faces)])


def torque_cuts(
    compiled: CompiledProblem, candidate: GraspCandidate, z: FloatArray, cuts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the supports along cuts under the hand's torque limits, and their gradients, solver units.

    They are (m,), and (m, n) in the program's variables.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
    z : (n,) array
        Variables of the cutting-plane program at the candidate.
    cuts : (m, 6) array
        Directions.
    """
    budget = compiled.budget(candidate)
    if not isinstance(budget, SharedJointTorqueLimits):
        raise InputError("force_budget", budget.kind, "a hand's torque limits")
    grasp = compiled.grasp(candidate)
    limits = budget.at(grasp.frames, grasp.contacts)
    work = cuts @ grasp.G
    x, prices = limits.maximise_with_prices(work)
    wrenches = np.array([grasp.contact_wrenches(forces) for forces in x]).reshape(len(cuts), len(grasp), 6)
    rates = prices[:, : len(budget.limits)] / budget.limits
    normals = compiled.inward_normals(candidate)
    slopes = compiled.virtual_work.slopes(z, normals, cuts, wrenches[:, :, :3], wrenches[:, :, 3:], rates)
    return compiled.scaling.beta * np.sum(work * x, axis=1), slopes
