"""Local search for robustness: maximises the worst-case quality over contact displacements.

A displacement is which of the places around it each contact slips to. Those that hurt most so far are kept; every
contact in turn moves to the place near it where the least quality over all of them is largest, and the search for
the worst displacement begins anew. Only what the certificate confirms is kept.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.optimize.after.robust import Places, places_around, places_near, robustness, worst_displacement
from nlpgrasp.optimize.ascent.weakest import QUICK, weakest_at
from nlpgrasp.optimize.surface.on_body import OnBody
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.quality.screening import sampled_ratios
from nlpgrasp.solution.findings import Robustness

STEPS = (0.04, 0.02, 0.01, 0.005)  # of the body's size
ROUNDS = 4  # of a step size
GAIN = 1e-3  # relative: a move that gains less is none
MOST_DIRECTIONS = 400


def steady(bench: Workbench, found: OnBody) -> tuple[OnBody, Robustness]:
    """Return a grasp made more robust, where its contacts move freely over a smooth body."""
    if found.surface is not None or not bench.follows_contacts:
        return found, robustness(bench, found.placed, found.grasp)
    best, robust = found.grasp, robustness(bench, found.placed, found.grasp)
    placed, ascent = found.placed, _Ascent(bench, found.placed)
    for step in STEPS:
        for _ in range(ROUNDS):
            ascent.look()
            if not ascent.move(step * bench.scaling.length):
                break
        there = ascent.placed
        grasp = bench.grasp(there)
        trial = robustness(bench, there, grasp)
        if trial.mu.lower > robust.mu.lower:
            placed, best, robust = there, grasp, trial
    return OnBody.of(bench, placed, best), robust


class _Ascent:
    """State of the search: contacts, worst displacements so far, and the weak directions."""

    def __init__(self, bench: Workbench, start: Placed) -> None:
        self.bench, self.start = bench, start
        share = bench.options.robust_friction
        self.models = [model.with_friction(1.0 - share) for model in bench.problem.models]
        self.points = start.points.copy()
        self.directions = np.zeros((0, bench.problem.dimension))
        self.displacements: list[tuple[int, ...]] = [(0,) * len(self.points)]

    @property
    def placed(self) -> Placed:
        """Current candidate."""
        return Placed(self.start.faces, self.points.copy(), self.start.hand)

    def look(self) -> None:
        """Add the worst displacement found of the current contacts, and the weak directions."""
        bench, rng = self.bench, np.random.default_rng(0)
        here = self.placed
        chosen, y = worst_displacement(bench, self.models, self._places(), bench.budget(here), rng)
        nominal = weakest_at(bench, here, np.random.default_rng(0), y, QUICK)
        self.directions = np.concatenate([self.directions, y, nominal.directions])[-MOST_DIRECTIONS:]
        if tuple(chosen) not in self.displacements:
            self.displacements.append(tuple(chosen))

    def move(self, step: float) -> bool:
        """Move contacts in turn to maximise the least ratio over the displacements; return whether any moved."""
        bench, moved = self.bench, False
        normals, now = bench.inward_normals(self.placed), self._places()
        for i, face in enumerate(self.start.faces):
            tried, inward = places_around(bench, face, self.points[i], normals[i], step)
            others = places_near(bench, [face] * (len(tried) - 1), tried[1:], inward[1:])
            around = [now[i], *others]
            values = np.array([self._least([*now[:i], one, *now[i + 1 :]]) for one in around])
            trials, trial_normals = (np.repeat(v[None], len(tried), axis=0) for v in (self.points, normals))
            trials[:, i], trial_normals[:, i] = tried, inward
            allowed = bench.rows.violations(trials, trial_normals, self.start.repeated_hand(len(tried))) <= FEASIBLE
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
        return places_near(self.bench, self.start.faces, self.points, self.bench.inward_normals(self.placed))
