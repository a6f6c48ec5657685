"""The file of the body that another tool reads, and its scale."""

from __future__ import annotations

from pathlib import Path

from nlpgrasp.common.given.lengths import UNITS
from nlpgrasp.solution.solution import GraspSolution


def object_file(solution: GraspSolution, given: str | None) -> str:
    """Return the body's file as it was given, else the name of its mesh file, else its type: a box has no file."""
    return given or str(solution.body.get("source") or solution.body.get("type", "body"))


def object_scale(solution: GraspSolution, given: str | None) -> float:
    """Return metres for a unit of the file's coordinates: of the body's own mesh file its unit, of another 1."""
    own, unit = solution.body.get("source"), solution.body.get("unit")
    if unit not in UNITS or (given is not None and Path(given).name != own):
        return 1.0
    return UNITS[unit]
