"""Uphill over the body's surface from where a design is heaviest: grasps for the bound to be compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.best.bound.weakest import Design, descended
from nlpgrasp.best.cells.base import Surface
from nlpgrasp.best.scope.pieces import Pieces
from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.tasks import Task

ROUNDS = 15
FIRST, LONGEST, LEAST = 0.1, 0.3, 2e-4  # steps, relative to the body's size
CUTS, KEPT = 40, 10  # directions in a step's program; of the latest
DIFFERENCE = 1e-6
GAIN = 1e-6
SOLVED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
HOPE = 1.0  # share of mu, over the rounds so far, that a climb may lack


@dataclass(frozen=True)
class Spot:
    """Where one contact is.

    Parameters
    ----------
    pieces : Pieces
        The cells it may be in.
    surface : Surface
        The face it is on.
    point, normal : (space,) array
        Metres; unit, into the body.
    """

    pieces: Pieces
    surface: Surface
    point: FloatArray
    normal: FloatArray

    def moved(self, step: FloatArray) -> Spot:
        """Return the spot a step (space - 1,) along the face."""
        points, normals = self.surface.moved(self.point, step[None])
        return Spot(self.pieces, self.surface, points[0], normals[0])

    @property
    def allowed(self) -> bool:
        """Whether constraints permit it."""
        return self.pieces.allowed.permits(self.point[None], self.normal[None], 1e-9)


class Climber:
    """Raises mu of grasps by small linear programs: all directions that may become the weakest rise alike.

    Parameters
    ----------
    task : Task
    twists : (m, d) array
        Well-spread directions with unit work of the task, to begin with.
    size : float
        Of the body, metres.
    """

    def __init__(self, task: Task, twists: FloatArray, size: float) -> None:
        self.task, self.twists, self.size = task, twists, size

    def learn(self, twists: FloatArray) -> None:
        """Begin descents from these directions (m, d) as well, where they are weak."""
        self.twists = np.concatenate([self.twists, twists])

    def climb(self, spots: Sequence[Spot], twists: FloatArray, known: float = 0.0) -> tuple[list[Spot], float]:
        """Return a grasp uphill of this one, and what its mu seems to be.

        Parameters
        ----------
        spots : sequence of k Spot
        twists : (m, d) array
            Directions that are weak there.
        known : float
            The mu to exceed: a climb that stays far below it ends early.
        """
        best = list(spots)
        value, cuts = self.weakest(best, twists)
        step = FIRST * self.size
        for i in range(ROUNDS):
            if value < known * (1.0 - HOPE / (1 + i)):
                break
            moved = self._uphill(best, cuts, step)
            if moved is None:
                break
            found, weak = self.weakest(moved, cuts)
            cuts = np.concatenate([weak[:KEPT], cuts])[:CUTS]
            if found > (1.0 + GAIN) * value:
                best, value, step = moved, found, min(1.5 * step, LONGEST * self.size)
                continue
            step *= 0.35
            if step < LEAST * self.size:
                break
        return best, value

    def weakest(self, spots: Sequence[Spot], twists: FloatArray) -> tuple[float, FloatArray]:
        """Return the least ratio that descents find, and their directions, weakest first."""
        designs, measure = _designs(spots), spots[0].pieces.supports.measure
        first = sum(design.value(self.twists[None])[0] for design in designs) ** (1.0 / measure.power)
        start = np.concatenate([twists[:KEPT], self.twists[np.argsort(first)[:6]]])
        found = descended(designs, self.task, start[None], 8)[0][0]
        ratios = measure.combined(np.concatenate([d.supports(found[None])[0] for d in designs], axis=1), 1)
        order = np.argsort(ratios)
        return float(ratios[order[0]]), found[order]

    def _uphill(self, spots: Sequence[Spot], cuts: FloatArray, step: float) -> list[Spot] | None:
        """Return the spots after the step that raises the least linearised support most, None where there is none."""
        total, slopes = self._differences(spots, cuts)
        q, m, n = spots[0].point.size - 1, len(cuts), slopes.shape[1]
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
        moved = [spot.moved(s) for spot, s in zip(spots, x[:-1].reshape(-1, q), strict=True)]
        return moved if all(spot.allowed for spot in moved) else None

    def _differences(self, spots: Sequence[Spot], cuts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support along cuts, (m,), and its slopes over steps of the spots, (m, k q)."""
        q, h, measure = spots[0].point.size - 1, DIFFERENCE * self.size, spots[0].pieces.supports.measure
        tries = np.concatenate([h * np.eye(q), -h * np.eye(q), np.zeros((1, q))])
        values = np.zeros((len(spots), len(tries), len(cuts)))
        for model, own in _by_model(spots).items():
            places = [spots[i].surface.moved(spots[i].point, tries) for i in own]
            supports = spots[own[0]].pieces.supports
            z = cuts @ supports.maps_at(*(np.concatenate([place[j] for place in places]) for j in range(2)))
            values[own] = (measure.support(model, z) ** measure.power).reshape(len(own), len(tries), len(cuts))
        total = np.maximum(np.sum(values[:, -1], axis=0), 1e-300)
        slopes = (values[:, :q] - values[:, q : 2 * q]).reshape(-1, len(cuts)).T / (2.0 * h)
        power = 1.0 / measure.power
        return total**power, slopes * (total ** (power - 1.0) * power)[:, None]


def _by_model(spots: Sequence[Spot]) -> dict[ContactModel, list[int]]:
    """Return which spots have contacts of the same model."""
    found: dict[ContactModel, list[int]] = {}
    for i, spot in enumerate(spots):
        found.setdefault(spot.pieces.supports.contact, []).append(i)
    return found


def _designs(spots: Sequence[Spot]) -> list[Design]:
    """Return the contacts in their places as designs, those of one model together."""
    result = []
    for model, own in _by_model(spots).items():
        supports = spots[own[0]].pieces.supports
        maps = supports.maps_at(np.stack([spots[i].point for i in own]), np.stack([spots[i].normal for i in own]))
        result.append(Design(model, supports.measure, maps[None], np.ones((1, len(own)))))
    return result


def _maximised(A: FloatArray, b: FloatArray) -> FloatArray | None:
    """Return x of the largest last component with ``A x <= b``, None where no solver finds one."""
    n = A.shape[1]
    objective = np.append(np.zeros(n - 1), -1.0)
    cones = [clarabel.NonnegativeConeT(len(b))]
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((n, n)), objective, sparse.csc_matrix(A), b, cones, quiet_settings(1e-9)
    )
    found = solver.solve()
    if found.status not in SOLVED:  # of an infeasible program x is a direction, as long as it may be
        return None
    return np.array(found.x)
