"""Sampled quality of placements near a grasp: least support ratio over spread and learned weak directions."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.optimize.ascent.weakest import QUICK, weakest_directions
from nlpgrasp.optimize.start.scores import screening_directions
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.quality.screening import sampled_ratios, screening_score

KNOWN, MOST_CUTS = 100, 400  # directions at first; directions kept, at most


class Scored:
    """Sampled quality with a growing set of weak directions.

    Parameters
    ----------
    bench : Workbench
    rng : numpy.random.Generator
    """

    def __init__(self, bench: Workbench, rng: np.random.Generator) -> None:
        self._bench, self._rng = bench, rng
        self._screening = screening_directions(bench)
        self._cuts = self._screening[:0]

    def look(self, points: FloatArray, normals: FloatArray) -> None:
        """Add the weakest directions of a grasp with these contacts, (k, space) each."""
        bench, known = self._bench, self._cuts[-KNOWN:]
        grasp, task = bench.grasp_at(points, normals), bench.problem.task
        found = weakest_directions(grasp, task, bench.closure_budget, self._rng, known, QUICK).directions
        self._cuts = np.concatenate([self._cuts, found])[-MOST_CUTS:]

    def of(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the sampled quality of placements (b, k, space), (b,).

        The least ratio over all directions, with the tie-break for placements that are not closed.
        """
        problem, y = self._bench.problem, np.concatenate([self._screening, self._cuts])
        stack = GraspStack(points, normals, problem.models, problem.origin)
        return screening_score(sampled_ratios(stack, problem.task, y, self._bench.screening_budget))
