"""CSV file of the study's results."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers.cases import BALL, LIFT, TURN, Case
from benchmarks.peers.judge import Evaluation

COLUMNS = ("body", "source", "fingers", "task", "method", "mu", "epsilon", "cpu_seconds", "note", "points")
TASKS: dict[tuple[float, ...], str] = {BALL: "ball", LIFT: "lift", TURN: "turn"}
RESULTS = Path(__file__).resolve().parents[1] / "results" / "peers.csv"


@dataclass(frozen=True)
class Row:
    """Line of the results file as the tables need it: lower bounds, and seconds of CPU time."""

    body: str
    source: str
    fingers: int
    task: str
    method: str
    mu: float
    epsilon: float
    seconds: float
    note: str


def write_header(path: Path) -> None:
    """Write a new results file that holds only the names of columns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerow(COLUMNS)


def append(path: Path, case: Case, evaluation: Evaluation) -> None:
    """Append the result of a method to the file.

    Contacts are in metres with 17 digits, so that results can be evaluated again.
    """
    points = ";".join(" ".join(repr(float(x)) for x in p) for p in evaluation.points)
    labels = [case.name, case.source, case.fingers, TASKS[case.shape], evaluation.method]
    values = [f"{evaluation.mu:.6g}", f"{evaluation.epsilon:.6g}", f"{evaluation.seconds:.2f}"]
    with path.open("a", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerow([*labels, *values, evaluation.note, points])


def read(path: Path) -> list[Row]:
    """Read the rows of a results file."""
    with path.open(newline="", encoding="utf-8") as file:
        return [
            Row(
                line["body"],
                line["source"],
                int(line["fingers"]),
                line["task"],
                line["method"],
                float(line["mu"]),
                float(line["epsilon"]),
                float(line["cpu_seconds"]),
                line["note"],
            )
            for line in csv.DictReader(file)
        ]
