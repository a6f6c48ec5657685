"""Options, progress reports and JSON lines shared by the commands."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

import nlpgrasp as ng
from nlpgrasp.common.files import writable_place
from nlpgrasp.common.formatting import format_measure
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.solution.records import StartRecord


Script = Annotated[Path, typer.Argument(metavar="SCRIPT", help="Python file with a function problem().")]
File = Annotated[Path, typer.Argument(metavar="F.json", help="Solution file.")]
Folders = Annotated[
    list[Path] | None,
    typer.Option("--folder", help="Where the file's mesh and URDF are looked for, after its own folder; repeatable."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Write JSON lines to standard output instead of text.")]
Gain = Annotated[
    float | None,
    typer.Option(
        "--gain", help="With --hand: gain of the servos of turning joints, N m / rad; by default the solution's."
    ),
]
Damping = Annotated[
    float | None, typer.Option("--damping", help="With --hand: damping of the joints, N m s / rad; 0.1 by default.")
]
FrictionLoss = Annotated[
    float | None,
    typer.Option("--frictionloss", help="With --hand: dry friction of the joints, N m; 0.005 by default."),
]
NormalForce = Annotated[
    float | None,
    typer.Option(
        "--normal-force",
        help="With --hand: the force that each finger presses with at least, newtons; by default the solution's.",
    ),
]
Rtol = Annotated[float, typer.Option("--rtol", help="Relative gap of the certificate.")]


def writable(target: Path, *sources: Path, ending: str = "") -> Path:
    """Return the absolute path of a result file; raise if the file cannot or should not be written."""
    if target.resolve() in [source.resolve() for source in sources]:
        raise InputError("--out", f"{target} (the script or file itself)", "another file")
    return writable_place("--out", target, ending)


def hand_options(values: Mapping[str, float | None], hand: Path | None, use: str) -> dict[str, float]:
    """Return the hand options that are set; raise if there are any without ``--hand``.

    Parameters
    ----------
    values : mapping of str to float or None
        By parameter, the option's name with underscores.
    hand : Path or None
        Value of ``--hand``, without which the options are refused.
    use : str
        Use of the options, for the message.
    """
    options = {name: value for name, value in values.items() if value is not None}
    if options and hand is None:
        name = next(iter(options))
        raise InputError(f"--{name.replace('_', '-')}", options[name], f"only with --hand, {use}")
    return options


class Reporter:
    """Progress of a solve's starts, as a bar or as JSON lines.

    Parameters
    ----------
    name : str
        The problem's name.
    starts : int
    as_json : bool
        One JSON object a line on standard output instead of a bar on standard error.
    """

    def __init__(self, name: str, starts: int, as_json: bool) -> None:
        self.name = name
        self.starts = starts
        self.as_json = as_json
        self._bar: Progress | None = None
        self._task = TaskID(0)

    def __enter__(self) -> Reporter:
        if not self.as_json:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("{task.fields[best]}"),
            )
            self._bar = Progress(*columns, console=Console(stderr=True))
            self._bar.start()
            self._task = self._bar.add_task(escape(self.name), total=self.starts, best="no grasp yet")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def start_done(self, record: StartRecord, best: ng.Bounds) -> None:
        """Report a finished start and the best certified bounds so far."""
        if self._bar is not None:
            text = f"best {format_measure(best.kind)} in {best}" if math.isfinite(best.upper) else "no grasp yet"
            self._bar.update(self._task, advance=1, best=text)
            return
        write_json_line(
            {
                "event": "start",
                "index": record.index,
                "status": record.status.name.lower(),
                "mu": bounds_pair(record.mu),
                "seconds": sum(record.seconds.values()),
                "best": bounds_pair(best),
            }
        )


@contextmanager
def report_steps(activity: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that reports steps on standard error.

    In a terminal there is one temporary line; elsewhere each step is a line.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda message: typer.echo(message, err=True)
        return
    with console.status(escape(activity)) as status:
        yield lambda message: status.update(escape(f"{activity}: {message}"))


def write_json_line(data: Mapping[str, object]) -> None:
    """Write data as one JSON line to standard output."""
    sys.stdout.write(json.dumps(data, allow_nan=False) + "\n")
    sys.stdout.flush()


def bounds_pair(bounds: ng.Bounds) -> list[float] | None:
    """Return ``[lower, upper]``, or ``None`` for unknown bounds."""
    return [bounds.lower, bounds.upper] if math.isfinite(bounds.upper) else None


def final_record(solution: ng.GraspSolution, path: str | None) -> dict[str, object]:
    """Return the last JSON record of a solve."""
    return {
        "event": "done",
        "status": solution.status.name.lower(),
        "message": solution.told,
        "fragile": solution.is_fragile,
        "kind": solution.kind,
        "mu": bounds_pair(solution.mu),
        "best_possible": solution.best_possible if math.isfinite(solution.best_possible) else None,
        "forces_needed": None if solution.needed is None else solution.needed.to_dict(),
        "grasps": len(solution.grasps),
        "seconds": solution.solver["seconds"]["total"],
        "file": path,
    }
