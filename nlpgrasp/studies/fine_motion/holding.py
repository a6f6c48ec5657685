"""Quality of the grasp that holds a body while a finger moves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, PointContact
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.motion.paths.footpath import Footpath, Station
from nlpgrasp.motion.paths.least_along import first_stations, least_along
from nlpgrasp.optimize.ascent.weakest import QUICK, weakest_directions
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.studies.fine_motion.records import FingerMove
from nlpgrasp.tasks import TaskEllipsoid

ROUGH = 6  # evenly spaced stations for estimating a slide
HELD_RTOL = 0.05
TOLERANCE, ARM = 1e-3, 0.2  # shares of the body's size: chord tolerance; arc length per radian of the normal


class Holding:
    """Quality of intermediate grasps while one finger moves.

    Parameters
    ----------
    problem : GraspProblem
    here, there : Grasp
    order : sequence of int
        Contact of ``there`` that each finger takes.
    paths : sequence of k sequences of Station
        Path of each finger from its contact to its new one.
    hold : TaskEllipsoid
        Task of the fingers meanwhile.
    """

    def __init__(
        self,
        problem: GraspProblem,
        here: Grasp,
        there: Grasp,
        order: Sequence[int],
        paths: Sequence[Sequence[Station]],
        hold: TaskEllipsoid,
    ) -> None:
        self.problem, self.hold = problem, hold
        self.here, self.there, self.order, self.paths = here, there, order, paths
        self.budget = L2Budget() if problem.budget.depends_on_frames else problem.budget
        size = problem.body.size
        self._ways = [Footpath(problem.body, path, ARM * size, TOLERANCE * size) for path in paths]
        self.others, self.sliding = cache(self._others), cache(self._sliding)

    def _others(self, moved: frozenset[int], finger: int) -> Bounds:
        """Return the certified quality of the other fingers alone."""
        return self._certified(self._grasp(moved, finger))

    def _sliding(self, moved: frozenset[int], finger: int) -> float:
        """Return an estimate of the least quality while the finger slides, from a few stations."""
        way = self._ways[finger]
        stations = first_stations(way.total, way.edges, ROUGH)
        return min(self._estimate(self._grasp(moved, finger, float(station))) for station in stations)

    def move(self, moved: frozenset[int], finger: int, slides: bool) -> FingerMove:
        """Return the move of a finger, certified for the other fingers alone and at stations of a slide."""
        path = np.array([station.point for station in self.paths[finger]])
        others = self.others(moved, finger)
        if not slides:
            return FingerMove(finger, path, slides, others)
        way, known = self._ways[finger], dict[float, Bounds]()

        def quality(station: float) -> float:
            known[station] = self._certified(self._grasp(moved, finger, station))
            return known[station].upper

        least_along(quality, first_stations(way.total, way.edges))
        lower, upper = min(b.lower for b in known.values()), min(b.upper for b in known.values())
        held = Bounds(max(lower, others.lower), max(upper, others.lower))  # at least that of the other fingers alone
        return FingerMove(finger, path, slides, held, stations=len(known), others=others)

    def _estimate(self, grasp: Grasp) -> float:
        return weakest_directions(grasp, self.hold, self.budget, np.random.default_rng(0), descents=QUICK).value

    def _certified(self, grasp: Grasp) -> Bounds:
        return mu(grasp, self.hold, HELD_RTOL, force_budget=self.budget)

    def _grasp(self, moved: frozenset[int], finger: int, station: float | None = None) -> Grasp:
        """Return the grasp of the other fingers, with the finger frictionless at a station of its path, if given."""
        places: list[tuple[FloatArray, FloatArray, ContactModel]] = [
            (self.there.points[self.order[i]], self.there.normals[self.order[i]], model)
            if i in moved
            else (self.here.points[i], self.here.normals[i], model)
            for i, model in enumerate(self.problem.models)
            if i != finger
        ]
        if station is not None:
            point, normal, _ = self._ways[finger].at(station)
            places.append((point, normal, PointContact()))
        points, normals, models = zip(*places, strict=True)
        return Grasp(points, normals, models, self.problem.origin)
