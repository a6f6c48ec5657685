"""Cutting planes: directions along which the program enforces the support inequalities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench

SAME = 1.0 - 1e-7  # cosine above which a direction counts as a known cut


def most_relevant(bench: Workbench, placed: Placed, cuts: FloatArray) -> FloatArray:
    """Return as many cuts (m, d) as the program has slots: those nearest to binding at a candidate."""
    if len(cuts) <= bench.exchange.slots:
        return cuts
    support = bench.wrench_set(placed).support(cuts)[0]
    return cuts[np.sort(np.argsort(support, kind="stable")[: bench.exchange.slots])]


def with_new(bench: Workbench, cuts: FloatArray, directions: FloatArray) -> FloatArray:
    """Return cuts (m, d) with the directions (n, d) appended that are not yet among them."""
    return np.concatenate([cuts, directions[new_directions(bench, cuts, directions)]])


def new_directions(bench: Workbench, known: FloatArray, directions: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of directions that are not among the known ones, compared in solver units."""
    a, b = known / bench.scaling.wrench, directions / bench.scaling.wrench
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(np.max(b @ a.T, axis=1) < SAME)


def no_cuts(bench: Workbench, placed: Placed) -> FloatArray:
    """Return the program's parameters (q,) with every slot empty: for the placement constraints alone."""
    return piece_parameters(bench, placed, np.zeros((0, bench.problem.dimension)))


def piece_parameters(bench: Workbench, placed: Placed, cuts: FloatArray) -> FloatArray:
    """Return the program's parameters (q,) for cuts (m, d), with the contact whose support is largest along each."""
    return slot_parameters(bench, placed.faces, cuts, bench.exchange.pieces(bench.grasp(placed), cuts))


def slot_parameters(
    bench: Workbench, faces: tuple[str, ...], cuts: FloatArray, pieces: FloatArray | None = None
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
