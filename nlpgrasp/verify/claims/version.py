"""Versions of solution files, by the fields that they have to state."""

from __future__ import annotations

from nlpgrasp.solution.solution import GraspSolution


def states_all(solution: GraspSolution) -> bool:
    """Return whether this version's solve wrote the file, which then states all hand and approach fields.

    Options in files of earlier versions lack ``link_tolerance``.
    """
    return "link_tolerance" in solution.solver.get("options", {})
