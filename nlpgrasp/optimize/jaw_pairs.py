"""Antipodal candidates for parallel jaws: pairs of contacts on the line along the first one's normal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import sampled_quality

PROJECTION_STEPS = 3  # alternating projections of the second contact onto the first one's normal and the surface

ObjectArray = NDArray[np.object_]


def opposite_candidates(compiled: CompiledProblem, distance: float, most: int) -> Iterator[GraspCandidate]:
    """Yield feasible antipodal pairs of positive quality, best first, those with a blocked approach last.

    Parameters
    ----------
    compiled : CompiledProblem
        Problem with parallel jaws.
    distance : float
        Least distance between the contacts of two pairs, metres.
    most : int
        Number of pairs, at most.
    """
    points, normals, faces = _antipodal_pairs(compiled)
    if not len(points):
        return
    hand = compiled.hand_functions.start(points, normals)
    feasible = np.flatnonzero(compiled.rows.violations(points, normals, hand) <= FEASIBLE)
    if not len(feasible):
        return
    quality = sampled_quality(compiled, points[feasible], normals[feasible])
    order = feasible[np.argsort(-quality, kind="stable")][: int(np.sum(quality > 0.0))]
    blocked = []
    for i in _select_spaced(points[order], distance)[:most]:
        candidate = GraspCandidate(tuple(faces[order[i]]), points[order[i]])
        if compiled.hand_functions.is_blocked(candidate.points):
            blocked.append(candidate)
        else:
            yield candidate
    yield from blocked


def _select_spaced(pairs: FloatArray, distance: float) -> list[int]:
    """Return the indices of contact pairs (b, 2, space) farther than ``distance`` from all selected before."""
    chosen = list[int]()
    for i, pair in enumerate(pairs):
        others = pairs[chosen]
        gaps = [np.linalg.norm(others - p, axis=2).max(axis=1) for p in (pair, pair[::-1])]
        if not chosen or np.min(gaps) > distance:
            chosen.append(i)
    return chosen


def _antipodal_pairs(compiled: CompiledProblem) -> tuple[FloatArray, FloatArray, ObjectArray]:
    """Return opposite surface samples made antipodal, as points, inward normals (b, 2, space) and faces (b, 2)."""
    tables, body = compiled.sample_tables, compiled.problem.body
    pairs = tables.pairs[: len(tables.pairs) // 2]  # the others are the same in reverse
    points, normals = tables.contacts_of(pairs)
    faces = np.stack([tables.samples(i).faces[pairs[:, i]] for i in range(2)], axis=1).astype(object)
    if not len(pairs):
        return points, normals, faces
    first, across, second = points[:, 0], normals[:, 0], points[:, 1]
    for _ in range(PROJECTION_STEPS):
        along = np.sum((second - first) * across, axis=1, keepdims=True)
        second, inward = _project(body, first + along * across, faces[:, 1])
    return np.stack([first, second], axis=1), np.stack([across, inward], axis=1), faces


def _project(body: Body, points: FloatArray, faces: ObjectArray) -> tuple[FloatArray, FloatArray]:
    """Return the points (b, space) projected onto their faces, and the inward normals there."""
    if isinstance(body, Mesh):
        positions, outward, _ = body.closest(points)
        return positions, -outward
    positions, inward = points.copy(), np.zeros_like(points)
    for name in sorted(set(faces.tolist())):
        on_face = np.asarray(faces == name)
        positions[on_face] = body.snap(name, points[on_face])
        inward[on_face] = -body.evaluate(name, positions[on_face])[2]
    return positions, inward
