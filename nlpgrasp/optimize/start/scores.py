"""Sampled quality scores for ranking many placements: least support ratio over well-spread directions."""

from __future__ import annotations

from nlpgrasp.common.directions import directions
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.quality.screening import sampled_ratios, screening_score


def scores(bench: Workbench, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the sampled quality of placements (b, k, space), (b,)."""
    stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
    ratios = sampled_ratios(stack, bench.problem.task, screening_directions(bench), bench.screening_budget)
    return screening_score(ratios) * bench.scaling.beta


def screening_directions(bench: Workbench) -> FloatArray:
    """Return well-spread directions in wrench space, isotropic in the solver's units, (m, d)."""
    return directions(bench.problem.dimension, 2) * bench.scaling.wrench
