"""Computation of missing analyses for a page or a picture."""

from __future__ import annotations

from nlpgrasp.analysis.analyse import added_words, analyse
from nlpgrasp.solution.solution import GraspSolution


def completed(solution: GraspSolution) -> tuple[GraspSolution, str]:
    """Return a solution with all analyses that its problem allows, and the names of those computed, as text."""
    if solution.grasp is None:
        return solution, ""
    found = analyse(solution)
    added = added_words(solution, found)
    return found, f"Computed for this page: {added}." if added else ""
