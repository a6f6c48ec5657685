"""Analyses that a page or a picture shows and a solution lacks, computed for it."""

from __future__ import annotations

from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.analyse import analyse, is_stated
from nlpgrasp.solve.options import ANALYSES


def completed(solution: GraspSolution) -> tuple[GraspSolution, str]:
    """Return a solution with all analyses that its problem allows, and which were computed, in words."""
    if solution.grasp is None:
        return solution, ""
    found = analyse(solution)
    added = [words for name, words in ANALYSES.items() if is_stated(found, name) and not is_stated(solution, name)]
    return found, f"Computed for this page: {', '.join(added)}." if added else ""
