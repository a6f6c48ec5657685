"""MuJoCo scene export: free fingertips, or the hand's own model."""

from __future__ import annotations

from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need
from nlpgrasp.mjcf import mjcf, mjcf_with_hand
from nlpgrasp.solution.solution import GraspSolution


def _scene(solution: GraspSolution, options: ExportOptions) -> str:
    if options.hand is None:
        return mjcf(solution)
    return mjcf_with_hand(solution, options.hand, options.scene, options.progress)


MJCF = ExportFormat("mjcf", ".xml", "a MuJoCo scene", _scene, Need.NOTHING, takes_hand=True)
