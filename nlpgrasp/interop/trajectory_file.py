"""CSV and JSON export of a hand's trajectory through the phases of a grasp."""

from __future__ import annotations

import json

from nlpgrasp.interop.base import ExportFormat, ExportOptions
from nlpgrasp.solution.phases.trajectory import trajectory
from nlpgrasp.solution.solution import GraspSolution


def _csv(solution: GraspSolution, _: ExportOptions) -> str:
    return trajectory(solution).to_csv()


def _json(solution: GraspSolution, _: ExportOptions) -> str:
    return json.dumps(trajectory(solution).to_dict(), allow_nan=False) + "\n"


TRAJECTORY = ExportFormat("trajectory", ".trajectory.csv", "a hand's way through its phases as a table", _csv)
TRAJECTORY_JSON = ExportFormat("trajectory_json", ".trajectory.json", "the same as JSON", _json)
