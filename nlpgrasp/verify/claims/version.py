"""Versions of solution files: which fields one has to state."""

from __future__ import annotations

from nlpgrasp.solution.solution import GraspSolution


def states_all(solution: GraspSolution) -> bool:
    """Return whether a solve of this version wrote a file, which then states every field of a hand and its way in.

    Files of earlier versions have no ``link_tolerance`` among the options.
    """
    return "link_tolerance" in solution.solver.get("options", {})
