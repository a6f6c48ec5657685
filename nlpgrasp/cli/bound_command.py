"""The command ``nlpgrasp bound``: upper bound of mu over all placements."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Script, bounds_pair, writable, write_json_line
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.common.formatting import format_headroom, format_lower, format_upper

if TYPE_CHECKING:
    from nlpgrasp.report.pictures import Moment

PROGRESS_INTERVAL = 1.0  # seconds between two lines of progress


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
    target = None if out is None else writable(out, script)  # before the script runs: it may change the folder
    picture_target = None if picture is None else writable(picture, script)
    if picture_target is not None:
        from nlpgrasp.common.optional_packages import pyplot

        pyplot("a picture")  # before the work
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problem = load_problem(script)
    progress = _Progress(sys.stderr.isatty())
    bound = ng.best_possible(problem, gap, time_limit, progress)
    if target is not None:
        bound.save(target)
    if picture_target is not None:
        from nlpgrasp.report.pictures import write_bound_picture

        write_bound_picture(problem, bound, progress.moments, picture_target)
    if as_json:
        write_json_line(_bound_data(bound, out))
    else:
        _print_bound(problem.name, bound, out)
        if picture is not None:
            typer.echo(f"  picture written to {picture}")
    if bound.grasp is None:
        raise typer.Exit(1)


class _Progress:
    """Progress of a branch-and-bound search: record of bounds, and one line per second on standard error.

    Parameters
    ----------
    is_written : bool
        Whether to write.
    """

    def __init__(self, is_written: bool) -> None:
        self._is_written = is_written
        self.moments: list[Moment] = []
        self._start_time = self._last = time.monotonic()

    def __call__(self, upper: float, mu: ng.Bounds, nodes: int) -> None:
        """Record bound and incumbent, and write a progress line if the last one is old."""
        now = time.monotonic()
        self.moments.append((now - self._start_time, upper, mu.lower))
        if self._is_written and now - self._last >= PROGRESS_INTERVAL:
            self._last = now
            seconds = now - self._start_time
            incumbent = f"best met {format_lower(mu.lower, 4)}" if mu.lower > 0.0 else "no grasp met"
            sys.stderr.write(f"{seconds:6.1f} s  mu at most {format_upper(upper, 4)}, {incumbent}, {nodes} nodes\n")
            sys.stderr.flush()


def _print_bound(name: str, bound: ng.BestPossible, out: Path | None) -> None:
    """Print a bound, the best grasp of the search, and the size of the certificate."""
    typer.echo(f"{name}: mu at most {format_upper(bound.upper, 6)} over all placements")
    if bound.grasp is None:
        typer.echo("  no grasp met that exerts the task's wrenches")
    else:
        closure = "as close as asked for" if bound.closed else "not as close as asked for"
        typer.echo(f"  best grasp met: mu certified in {bound.mu}; {format_headroom(bound.gap)} ({closure})")
        for i, (face, point) in enumerate(zip(bound.faces, bound.grasp.points.tolist(), strict=True)):
            typer.echo(f"  contact {i} on {face} at {', '.join(f'{x:.4g}' for x in point)}")
    for part in bound.dropped:
        typer.echo(f"  left out: {part}, which only lowers mu")
    leaves = len(bound.certificate["leaves"])
    typer.echo(f"  {bound.nodes} nodes, {bound.seconds:.1f} s, {leaves} leaves in the certificate")
    if out is not None:
        typer.echo(f"  written to {out}")


def _bound_data(bound: ng.BestPossible, out: Path | None) -> dict[str, object]:
    """Return the bound as JSON data, without the certificate."""
    data = bound.to_dict()
    values = {key: data[key] for key in ("upper", "gap", "closed", "nodes", "seconds", "dropped", "grasp")}
    return {**values, "mu": bounds_pair(bound.mu), "written": None if out is None else str(out)}
