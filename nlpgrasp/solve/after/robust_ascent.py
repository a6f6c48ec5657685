"""From a grasp to a more robust one nearby: contacts moved so that the worst of their displacements hurts less.

A displacement is which of the places around it each contact slips to. Those that hurt most so far are kept; every
contact in turn moves to the place near it where the least quality over all of them is largest, and the search for
the worst displacement begins anew. Only what the certificate confirms is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.screening import sampled_ratios
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solve.after.robust import Places, places_around, robustness, worst_displacement
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.surface.put import OnBody, kept
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

STEPS = (0.04, 0.02, 0.01, 0.005)  # of the body's size
ROUNDS = 4  # of a step size
GAIN = 1e-3  # relative: a move that gains less is none
MOST_DIRECTIONS = 400


def steadied(bench: Workbench, faces: tuple[str, ...], found: OnBody) -> tuple[OnBody, Robustness]:
    """Return what a start found, made more robust where its contacts move freely over a smooth body."""
    offset, share = bench.options.robust_offset, bench.options.robust_friction
    hand = found.hand or {}
    if found.surface is not None or not bench.follows_contacts:
        return found, robustness(bench, faces, found.grasp, hand, offset, share)
    grasp, robust = more_robust(bench, faces, found.grasp, hand, offset, share)
    return kept(bench, grasp, hand, None), robust


def more_robust(
    bench: Workbench, faces: tuple[str, ...], grasp: Grasp, hand: dict[str, FloatArray], offset: float, share: float
) -> tuple[Grasp, Robustness]:
    """Return a grasp near this one whose worst placement is better, or this one, with its robustness.

    Parameters
    ----------
    bench : Workbench
        Of a problem whose contacts move freely over the body: no hand with a pose of its own.
    faces : tuple of k str
    grasp : Grasp
    hand : dict
    offset, share : float
        How far contacts may be off, metres, and by which share friction may be less.
    """
    best = grasp, robustness(bench, faces, grasp, hand, offset, share)
    models = [model.with_friction(1.0 - share) for model in grasp.contacts]
    ascent = _Ascent(bench, faces, models, grasp.points, hand, offset)
    for step in STEPS:
        for _ in range(ROUNDS):
            ascent.look()
            if not ascent.move(step * bench.scaling.length):
                break
        there = bench.grasp(faces, ascent.points)
        found = robustness(bench, faces, there, hand, offset, share)
        if found.mu.lower > best[1].mu.lower:
            best = there, found
    return best


class _Ascent:
    """Contacts on their way, the displacements that hurt most so far, and the directions in which they do."""

    def __init__(
        self,
        bench: Workbench,
        faces: tuple[str, ...],
        models: Sequence[ContactModel],
        points: FloatArray,
        hand: dict[str, FloatArray],
        offset: float,
    ) -> None:
        self.bench, self.faces, self.models, self.hand, self.offset = bench, faces, models, hand, offset
        self.points = points.copy()
        self.directions = np.zeros((0, bench.problem.dimension))
        self.displacements: list[tuple[int, ...]] = [(0,) * len(points)]

    def look(self) -> None:
        """Add the worst displacement found of the contacts where they are, and the weak directions."""
        bench, rng = self.bench, np.random.default_rng(0)
        budget = bench.budget(self.points, self.hand)
        chosen, y = worst_displacement(bench, self.models, self._places(), budget, rng)
        here = bench.grasp(self.faces, self.points)
        nominal = weakest_directions(here, bench.problem.task, y, np.random.default_rng(0), budget, 60, 25)
        self.directions = np.concatenate([self.directions, y, nominal.directions])[-MOST_DIRECTIONS:]
        if tuple(chosen) not in self.displacements:
            self.displacements.append(tuple(chosen))

    def move(self, step: float) -> bool:
        """Move contacts in turn to where the displacements hurt least; return whether any moved."""
        bench, moved = self.bench, False
        normals, now = bench.inward_normals(self.faces, self.points), self._places()
        for i, face in enumerate(self.faces):
            tried, inward = places_around(bench, face, self.points[i], normals[i], step)
            around = [now[i]]
            around += [
                places_around(bench, face, p, n, self.offset) for p, n in zip(tried[1:], inward[1:], strict=True)
            ]
            values = np.array([self._least([*now[:i], one, *now[i + 1 :]]) for one in around])
            trials, trial_normals = (np.repeat(v[None], len(tried), axis=0) for v in (self.points, normals))
            trials[:, i], trial_normals[:, i] = tried, inward
            hand = {name: np.repeat(v[None], len(tried), axis=0) for name, v in self.hand.items()}
            allowed = bench.violations(trials, trial_normals, hand) <= FEASIBLE
            best = int(np.argmax(np.where(allowed, values, -np.inf)))
            if best > 0 and values[best] > (1.0 + GAIN) * values[0]:
                self.points[i], normals[i], now[i], moved = tried[best], inward[best], around[best], True
        return moved

    def _least(self, places: Places) -> float:
        """Return the least support ratio over displacements and directions."""
        chosen = [[min(c, len(places[i][0]) - 1) for i, c in enumerate(one)] for one in self.displacements]
        p, n = (np.array([[places[i][j][c] for i, c in enumerate(one)] for one in chosen]) for j in (0, 1))
        stack = GraspStack(p, n, self.models, self.bench.problem.origin)
        ratios = sampled_ratios(stack, self.bench.problem.task, self.directions, self.bench.screening_budget)
        return float(np.min(ratios))

    def _places(self) -> Places:
        normals = self.bench.inward_normals(self.faces, self.points)
        each = zip(self.faces, self.points, normals, strict=True)
        return [places_around(self.bench, face, p, n, self.offset) for face, p, n in each]
