"""Import of grasps from solution files, which state task and force budget."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.solution.solution import GraspSolution


def _read(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasp of a solution file."""
    solution = GraspSolution.load(path)
    if solution.grasp is None:
        raise InputError(f"{path}: grasp", "none", "a file that holds a grasp")
    yield ReadGrasp(solution.name, solution.grasp, solution.task, solution.budget)


SOLUTION = ReadFormat((".json",), ("problem",), _read)
