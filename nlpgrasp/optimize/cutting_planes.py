"""Cutting planes: weakest directions of candidates, along which the program enforces the support inequalities.

Directions are searched at a candidate, selected for the slots of the program, and passed to it as its parameters.
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
from nlpgrasp.quality.containment import condition
from nlpgrasp.quality.ratio_minimisation import descend, iterate, newton, random_directions, select_separated
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
    _unit_reach,
    to_coordinates,
    weaker_in_polytope,
    weakest_directions,
)

SAME = 1.0 - 1e-7  # cosine above which a direction counts as a known cut


def weakest_at(
    bench: CompiledProblem,
    placed: GraspCandidate,
    rng: np.random.Generator,
    known: FloatArray | None = None,
    descents: DescentSettings = THOROUGH,
) -> WeakestDirections:
    """Return the weakest directions of a candidate against the problem's task; see ``weakest_directions``."""
    return weakest_directions(bench.grasp(placed), bench.problem.task, bench.budget(placed), rng, known, descents)


def minimise_nearby(
    bench: CompiledProblem, placed: GraspCandidate, rng: np.random.Generator, known: FloatArray
) -> WeakestDirections:
    """Return the weakest directions of a candidate as local minimisers to rounding, however close together.

    They are looked for from known directions, such as those of a state nearby, and from a few random ones.
    """
    problem, _ = condition(bench.wrench_set(placed), bench.problem.task)
    if problem is None:
        return WeakestDirections(0.0, known[:0])
    start = np.concatenate([to_coordinates(problem, known), random_directions(FRESH, problem.rank, rng)])
    squared = isinstance(bench.budget(placed), L2Budget)
    found, values = iterate(problem, start, BEGUN) if squared else descend(problem, start, BEGUN)
    order = np.argsort(values)
    chosen = select_separated(found, order[values[order] <= SLACK * values[order[0]]], DIFFERENT, KEEP)
    found, values = newton(problem, found[chosen], NEWTON_STEPS)
    order = np.argsort(values)
    chosen = select_separated(found, order, DIFFERENT, KEEP)
    return WeakestDirections(float(values[chosen[0]]), _unit_reach(bench.problem.task, found[chosen] @ problem.matrix))


def find_weaker(
    bench: CompiledProblem, placed: GraspCandidate, value: float
) -> tuple[WeakestDirections | None, ResumableCertificate | None]:
    """Return directions in which a candidate is weaker than its known value, None where there are none.

    Descents miss a narrow dip that no start is near, and stop at the kinks of other budgets than the paper's; a
    certificate's polytope does not. That is returned too, where there is one.
    """
    budget = bench.budget(placed)
    if value <= 0.0:
        return None, None
    if not isinstance(budget, L2Budget):
        found = weakest_at(bench, placed, np.random.default_rng(0))
        return (found if found.value < value * (1.0 - NEWS) else None), None
    begun = ResumableCertificate.of(bench.grasp(placed), bench.problem.task, budget, LOOK)
    return (None if begun is None else weaker_in_polytope(begun, value)), begun


def most_relevant(bench: CompiledProblem, placed: GraspCandidate, cuts: FloatArray) -> FloatArray:
    """Return as many cuts (m, d) as the program has slots: those nearest to binding at a candidate."""
    if len(cuts) <= bench.exchange.slots:
        return cuts
    support = bench.wrench_set(placed).support(cuts)[0]
    return cuts[np.sort(np.argsort(support, kind="stable")[: bench.exchange.slots])]


def append_new(bench: CompiledProblem, cuts: FloatArray, directions: FloatArray) -> FloatArray:
    """Return cuts (m, d) with the directions (n, d) appended that are not yet among them."""
    return np.concatenate([cuts, directions[new_directions(bench, cuts, directions)]])


def new_directions(bench: CompiledProblem, known: FloatArray, directions: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of directions that are not among the known ones, compared in solver units."""
    a, b = known / bench.scaling.wrench, directions / bench.scaling.wrench
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(np.max(b @ a.T, axis=1) < SAME)


def empty_slots(bench: CompiledProblem, placed: GraspCandidate) -> FloatArray:
    """Return the program's parameters (q,) with every slot empty: for the placement constraints alone."""
    return piece_parameters(bench, placed, np.zeros((0, bench.problem.dimension)))


def piece_parameters(bench: CompiledProblem, placed: GraspCandidate, cuts: FloatArray) -> FloatArray:
    """Return the program's parameters (q,) for cuts (m, d), with the contact whose support is largest along each."""
    return slot_parameters(bench, placed.faces, cuts, bench.exchange.pieces(bench.grasp(placed), cuts))


def slot_parameters(
    bench: CompiledProblem, faces: tuple[str, ...], cuts: FloatArray, pieces: FloatArray | None = None
) -> FloatArray:
    """Return the program's parameters for cuts with ``phi_A = 1``; the other slots stay empty.

    Parameters
    ----------
    bench : Workbench
    faces : tuple of k str
    cuts : (m, d) array
    pieces : (m, k) array, optional
        The contacts' own supports along the cuts, where the program wants the largest of them.
    """
    if bench.problem.budget.follows_hand:  # the program holds no cuts
        return face_parameters(bench.problem, faces)
    slots = bench.exchange.slots
    directions = np.zeros((slots, bench.problem.dimension))
    directions[: len(cuts)] = cuts
    reach = np.zeros(slots)
    reach[: len(cuts)] = 1.0
    weights = np.zeros(0)
    if pieces is not None:
        weights = np.zeros((slots, pieces.shape[1]))
        weights[np.arange(len(cuts)), np.argmax(pieces, axis=1)] = 1.0
    return np.concatenate([directions.ravel(), reach, weights.ravel(), face_parameters(bench.problem, faces)])


def torque_cuts(
    bench: CompiledProblem, placed: GraspCandidate, z: FloatArray, cuts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the supports along cuts (m,) and their gradients in the program's variables (m, n), in solver units.

    Parameters
    ----------
    bench : Workbench
    placed : Placed
    z : (n,) array
        The same as variables of the exchange's program.
    cuts : (m, 6) array
        Directions.
    """
    budget = bench.budget(placed)
    if not isinstance(budget, SharedJointTorqueLimits):
        raise InputError("force_budget", budget.kind, "a hand's torque limits")
    grasp = bench.grasp(placed)
    limits = budget.at(grasp.frames, grasp.contacts)
    work = cuts @ grasp.G
    x, prices = limits.prices(work)
    wrenches = np.array([grasp.contact_wrenches(one) for one in x]).reshape(len(cuts), len(grasp), 6)
    rates = prices[:, : len(budget.limits)] / budget.limits
    normals = bench.inward_normals(placed)
    slopes = bench.virtual_work.slopes(z, normals, cuts, wrenches[:, :, :3], wrenches[:, :, 3:], rates)
    return bench.scaling.beta * np.sum(work * x, axis=1), slopes
