"""The command ``nlpgrasp bound``."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Script, emit, pair, writable
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.common.formatting import at_least, at_most, headroom_words

if TYPE_CHECKING:
    from nlpgrasp.report.pictures import Moment

EVERY = 1.0  # seconds between two lines of progress


def bound_command(
    script: Script,
    gap: Annotated[float, typer.Option("--gap", help="Relative gap to the best grasp met at which to stop.")] = 0.01,
    time_limit: Annotated[float, typer.Option("--time-limit", help="Seconds of wall time.")] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", help="Bound and certificate, for nlpgrasp verify; not kept by default.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="F.png", help="How the gap closed, and where a contact is worth most."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Bound mu over all placements of a problem script. Ctrl-C keeps the bound so far."""
    place = None if out is None else writable(out, script)  # before the script runs: it may change the folder
    shown = None if picture is None else writable(picture, script)
    if shown is not None:
        from nlpgrasp.common.optional_packages import pyplot

        pyplot("a picture")  # before the work
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problem = load_problem(script)
    progress = _Progress(sys.stderr.isatty())
    found = ng.best_possible(problem, gap, time_limit, progress)
    if place is not None:
        found.save(place)
    if shown is not None:
        from nlpgrasp.report.pictures import write_bound_picture

        write_bound_picture(problem, found, progress.moments, shown)
    if as_json:
        emit(_data(found, out))
    else:
        _show(problem.name, found, out)
        if picture is not None:
            typer.echo(f"  picture written to {picture}")
    if found.grasp is None:
        raise typer.Exit(1)


class _Progress:
    """Remembers bound and best grasp at every moment, and writes them to standard error, a line a second.

    Parameters
    ----------
    told : bool
        Whether to write.
    """

    def __init__(self, told: bool) -> None:
        self._told = told
        self.moments: list[Moment] = []
        self._begun = self._last = time.monotonic()

    def __call__(self, upper: float, mu: ng.Bounds, nodes: int) -> None:
        """Remember, and write a line where the last one is old."""
        now = time.monotonic()
        self.moments.append((now - self._begun, upper, mu.lower))
        if self._told and now - self._last >= EVERY:
            self._last = now
            met = f"best met {at_least(mu.lower, 4)}" if mu.lower > 0.0 else "no grasp met"
            sys.stderr.write(f"{now - self._begun:6.1f} s  mu at most {at_most(upper, 4)}, {met}, {nodes} nodes\n")
            sys.stderr.flush()


def _show(name: str, found: ng.BestPossible, out: Path | None) -> None:
    typer.echo(f"{name}: mu at most {at_most(found.upper, 6)} over all placements")
    if found.grasp is None:
        typer.echo("  no grasp met that exerts the task's wrenches")
    else:
        closed = "as close as asked for" if found.closed else "not as close as asked for"
        typer.echo(f"  best grasp met: mu certified in {found.mu}; {headroom_words(found.gap)} ({closed})")
        for i, (face, point) in enumerate(zip(found.faces, found.grasp.points.tolist(), strict=True)):
            typer.echo(f"  contact {i} on {face} at {', '.join(f'{x:.4g}' for x in point)}")
    for part in found.dropped:
        typer.echo(f"  left out: {part}, which only lowers mu")
    leaves = len(found.certificate["leaves"])
    typer.echo(f"  {found.nodes} nodes, {found.seconds:.1f} s, {leaves} leaves in the certificate")
    if out is not None:
        typer.echo(f"  written to {out}")


def _data(found: ng.BestPossible, out: Path | None) -> dict[str, object]:
    """Return what is found as JSON data, without the certificate."""
    data = found.to_dict()
    kept = {key: data[key] for key in ("upper", "gap", "closed", "nodes", "seconds", "dropped", "grasp")}
    return {**kept, "mu": pair(found.mu), "written": None if out is None else str(out)}
