"""What holds a body while a finger moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, PointContact
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solve.ascent.weakest import QUICK, weakest_directions
from nlpgrasp.studies.fine_motion.paths.surface_paths import SurfaceGraph
from nlpgrasp.studies.fine_motion.records import FingerMove
from nlpgrasp.tasks import TaskEllipsoid

WAYPOINTS = 6  # of a path, at which a sliding finger is looked at
HELD_RTOL = 0.05


class Holding:
    """How well a body is held while one finger moves and some have moved already."""

    def __init__(
        self,
        problem: GraspProblem,
        graph: SurfaceGraph,
        here: Grasp,
        there: Grasp,
        order: Sequence[int],
        hold: TaskEllipsoid,
    ) -> None:
        self.problem, self.hold = problem, hold
        self.here, self.there, self.order = here, there, order
        self.budget = L2Budget() if problem.budget.depends_on_frames else problem.budget
        self.paths = [graph.path(here.points[i], there.points[order[i]]) for i in range(len(here))]
        self._known: dict[tuple[frozenset[int], int], tuple[float, float]] = {}

    def strengths(self, moved: frozenset[int], finger: int) -> tuple[float, float]:
        """Return estimates of the quality with the finger lifted, and with it sliding without friction."""
        key = (moved, finger)
        if key not in self._known:
            rng = np.random.default_rng(0)
            values = [
                [
                    weakest_directions(grasp, self.hold, self.budget, rng, descents=QUICK).value
                    for grasp in self._grasps(moved, finger, slides)
                ]
                for slides in (False, True)
            ]
            self._known[key] = (min(values[0]), min(values[1]))
        return self._known[key]

    def move(self, moved: frozenset[int], finger: int, slides: bool) -> FingerMove:
        """Return the move of a finger, certified."""
        bounds = [
            mu(grasp, self.hold, HELD_RTOL, force_budget=self.budget) for grasp in self._grasps(moved, finger, slides)
        ]
        held = Bounds(min(b.lower for b in bounds), min(b.upper for b in bounds))
        return FingerMove(finger, self.paths[finger][0], slides, held)

    def _grasps(self, moved: frozenset[int], finger: int, slides: bool) -> list[Grasp]:
        """Return the grasp of the other fingers; sliding, with the finger at points along its path."""
        places = [
            (self.there.points[self.order[i]], self.there.normals[self.order[i]], model)
            if i in moved
            else (self.here.points[i], self.here.normals[i], model)
            for i, model in enumerate(self.problem.models)
            if i != finger
        ]
        if not slides:
            return [self._grasp(places)]
        points, normals = self.paths[finger]
        stops = np.unique(np.linspace(0, len(points) - 1, WAYPOINTS).round().astype(int))
        return [self._grasp([*places, (points[j], normals[j], PointContact())]) for j in stops]

    def _grasp(self, places: Sequence[tuple[FloatArray, FloatArray, ContactModel]]) -> Grasp:
        points, normals, models = zip(*places, strict=True)
        return Grasp(points, normals, models, self.problem.origin)
