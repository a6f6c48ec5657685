"""A step uphill: a small linear program in which all directions that may become the weakest rise alike."""

from __future__ import annotations

from collections.abc import Sequence

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.best.spots import Spot, Spots, by_model
from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.validation import FloatArray

DIFFERENCE = 1e-6  # of the body's size
SOLVED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)


def uphill(
    grasps: Sequence[Spots], cuts: Sequence[FloatArray], steps: Sequence[float], size: float
) -> list[list[Spot] | None]:
    """Return each grasp after the step that raises its least linearised support most, None where there is none.

    Parameters
    ----------
    grasps : sequence of b sequences of k Spot
        Their contacts alike.
    cuts : sequence of b (m, d) arrays
        Directions of each.
    steps : sequence of b float
        How far a contact may go, metres.
    size : float
        Of the body, metres.
    """
    total, slopes = _differences(grasps, cuts, size)
    rows = (len(own) for own in cuts)
    return [
        _stepped(spots, total[i, :m], slopes[i, :m], steps[i])
        for i, (spots, m) in enumerate(zip(grasps, rows, strict=True))
    ]


def _stepped(spots: Spots, total: FloatArray, slopes: FloatArray, step: float) -> list[Spot] | None:
    """Return spots after the best step, from supports (m,) and their slopes over the contacts' steps, (m, k q)."""
    m, n = slopes.shape
    q = n // len(spots)
    limits = [spot.surface.limits(spot.point) for spot in spots]
    used = sum(len(b) for _, b in limits)
    A, b = np.zeros((m + used + 2 * n, n + 1)), np.full(m + used + 2 * n, step)
    A[:m, :-1], A[:m, -1], b[:m] = -slopes, 1.0, total
    at = m
    for i, (sides, offsets) in enumerate(limits):
        A[at : at + len(offsets), i * q : (i + 1) * q], b[at : at + len(offsets)] = sides, offsets
        at += len(offsets)
    A[at : at + n, :n], A[at + n :, :n] = np.eye(n), -np.eye(n)
    x = _maximised(A, b)
    if x is None:
        return None
    return [spot.moved(s) for spot, s in zip(spots, x[:-1].reshape(-1, q), strict=True)]


def _differences(grasps: Sequence[Spots], cuts: Sequence[FloatArray], size: float) -> tuple[FloatArray, FloatArray]:
    """Return supports along cuts, (b, m), and their slopes over steps of the spots, (b, m, k q); the last repeated."""
    b, k, q = len(grasps), len(grasps[0]), grasps[0][0].point.size - 1
    h, measure = DIFFERENCE * size, grasps[0][0].pieces.supports.measure
    tries = np.concatenate([h * np.eye(q), -h * np.eye(q), np.zeros((1, q))])
    most = max(len(own) for own in cuts)
    y = np.stack([np.pad(own, ((0, most - len(own)), (0, 0)), mode="edge") for own in cuts])
    values = np.zeros((b, k, len(tries), most))
    for model, own in by_model(grasps[0]).items():
        places = [spots[i].surface.moved(spots[i].point, tries) for spots in grasps for i in own]
        maps = grasps[0][own[0]].pieces.supports.maps_at(*(np.concatenate([p[j] for p in places]) for j in range(2)))
        z = y[:, None] @ maps.reshape(b, -1, *maps.shape[1:])
        values[:, own] = (measure.support(model, z) ** measure.power).reshape(b, len(own), len(tries), most)
    total = np.maximum(np.sum(values[:, :, -1], axis=1), 1e-300)
    slopes = (values[:, :, :q] - values[:, :, q : 2 * q]).reshape(b, k * q, most).transpose(0, 2, 1) / (2.0 * h)
    power = 1.0 / measure.power
    return total**power, slopes * (total ** (power - 1.0) * power)[:, :, None]


def _maximised(A: FloatArray, b: FloatArray) -> FloatArray | None:
    """Return x of the largest last component with ``A x <= b``, None where no solver finds one."""
    m, n = A.shape
    objective = np.append(np.zeros(n - 1), -1.0)
    cones = [clarabel.NonnegativeConeT(m)]
    columns = sparse.csc_matrix((A.T.ravel(), np.tile(np.arange(m), n), np.arange(0, m * n + 1, m)), shape=(m, n))
    solver = clarabel.DefaultSolver(sparse.csc_matrix((n, n)), objective, columns, b, cones, quiet_settings(1e-9))
    found = solver.solve()
    if found.status not in SOLVED:  # of an infeasible program x is a direction, as long as it may be
        return None
    return np.array(found.x)
