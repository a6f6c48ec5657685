"""The study's rows as a CSV file, one written as soon as it is there."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers.cases import BALL, LIFT, TURN, Case
from benchmarks.peers.judge import Judged

COLUMNS = ("body", "source", "fingers", "task", "method", "mu", "epsilon", "cpu_seconds", "note", "points")
TASKS: dict[tuple[float, ...], str] = {BALL: "ball", LIFT: "lift", TURN: "turn"}
RESULTS = Path(__file__).resolve().parents[1] / "results" / "peers.csv"


@dataclass(frozen=True)
class Row:
    """What the tables need of one line of the file; lower bounds, and seconds of CPU time."""

    body: str
    source: str
    fingers: int
    task: str
    method: str
    mu: float
    epsilon: float
    seconds: float
    note: str


def begin(path: Path) -> None:
    """Write a file that holds the columns' names alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerow(COLUMNS)


def append(path: Path, case: Case, found: Judged) -> None:
    """Write one more line; contacts in metres to 17 digits, so that anyone can judge them again."""
    points = ";".join(" ".join(repr(float(x)) for x in p) for p in found.points)
    facts = [case.name, case.source, case.fingers, TASKS[case.shape], found.method]
    numbers = [f"{found.mu:.6g}", f"{found.epsilon:.6g}", f"{found.seconds:.2f}"]
    with path.open("a", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerow([*facts, *numbers, found.note, points])


def read(path: Path) -> list[Row]:
    """Return the rows of a file."""
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
