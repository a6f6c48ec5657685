"""File of the body for another tool, and its scale."""

from __future__ import annotations

from pathlib import Path

from nlpgrasp.common.given.lengths import UNITS
from nlpgrasp.solution.solution import GraspSolution


def object_file(solution: GraspSolution, given: str | None) -> str:
    """Return the given file of the body, else the name of its mesh file, else its type."""
    return given or str(solution.body.get("source") or solution.body.get("type", "body"))


def object_scale(solution: GraspSolution, given: str | None) -> float:
    """Return metres per unit of the file's coordinates: the unit of the body's own mesh file, else 1."""
    own, unit = solution.body.get("source"), solution.body.get("unit")
    if unit not in UNITS or (given is not None and Path(given).name != own):
        return 1.0
    return UNITS[unit]
