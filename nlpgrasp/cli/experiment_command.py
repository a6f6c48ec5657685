"""The command ``nlpgrasp experiment``: solves of all variations of a problem."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from math import isfinite
from pathlib import Path
from types import TracebackType
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, bounds_pair, write_json_line
from nlpgrasp.cli.problem_script import load_experiment
from nlpgrasp.errors import InputError, MissingExtraError

TABLE, PARQUET, PAGE = "table.csv", "table.parquet", "report.html"

ExperimentScript = Annotated[Path, typer.Argument(metavar="SCRIPT", help="Python file with a function experiment().")]


def experiment_command(
    script: ExperimentScript,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results, new or empty.")],
    resume: Annotated[bool, typer.Option("--resume", help="Do only what is missing in DIR.")] = False,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; one a core by default.")] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster that solves instead.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Solve all variations of an experiment script; each finished solve is a file. Ctrl-C keeps what is done."""
    from nlpgrasp.cli.live_experiment import LiveExperiment

    folder = out.absolute()  # before the script runs: it may change the working directory
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        experiment = load_experiment(script)
    with InterruptOnce():
        with LiveExperiment(experiment, as_json) as live:
            result = ng.run_experiment(
                experiment, folder, resume=resume, workers=workers, scheduler=scheduler, progress=live.solve_done
            )
        missing = write_outputs(result)
    if as_json:
        write_json_line(_final_record(result, missing))
    else:
        typer.echo(str(result))
        for line in missing:
            typer.echo(line)
        typer.echo(f"in {out}: solves/, {', '.join(p.name for p in sorted(folder.glob('*.*')) if p.name[0] != '.')}")
    if not (result.complete and result.success):
        raise typer.Exit(1)


class InterruptOnce:
    """Handler of Ctrl-C: the first one interrupts the run, and later ones are ignored."""

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGINT, self._handle)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _handle(self, *_: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        raise KeyboardInterrupt


def write_outputs(result: ng.ExperimentResult) -> list[str]:
    """Write table, pictures and page of an experiment, and return a message for each failure."""
    from nlpgrasp.experiments.experiment_result import write_csv, write_parquet
    from nlpgrasp.report.experiment_page import write_page, write_plots

    failures = []
    pictures: list[Path] = []

    def attempt(write: Callable[..., Path | list[Path]], *arguments: object) -> None:
        try:
            paths = write(*arguments)
            if isinstance(paths, list):
                pictures.extend(paths)
        except (MissingExtraError, InputError) as error:
            failures.append(str(error))

    attempt(write_csv, result.rows(), result.folder / TABLE)
    attempt(write_parquet, result.rows(), result.folder / PARQUET)
    attempt(write_plots, result, result.folder)
    attempt(write_page, result, result.folder / PAGE, pictures)
    return failures


def _final_record(result: ng.ExperimentResult, missing: list[str]) -> dict[str, object]:
    """Return the last JSON record of an experiment."""
    variations = [
        {
            "variation": v.name,
            "rank": rank,
            "mu": bounds_pair(v.mu) if v.best is not None else None,
            "best_possible": v.best_possible if isfinite(v.best_possible) else None,
            "gap": v.gap if isfinite(v.gap) else None,
            "origin": v.best.origin if v.best is not None else "",
            "ties": list(ties),
            "seconds": v.seconds,
            "starts": list(v.starts),
            "active": list(v.best.active) if v.best is not None else [],
        }
        for v, rank, ties in zip(result.variations, result.ranks(), result.ties(), strict=True)
    ]
    failures = [{"variation": s.variation, "seed": s.seed, "failure": s.failure} for s in result.failures]
    return {
        "event": "done",
        "complete": result.complete,
        "comparable": result.comparable,
        "variations": variations,
        "failures": failures,
        "notes": [*result.notes, *missing],
        "folder": str(result.folder),
    }
