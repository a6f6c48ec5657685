"""The command ``nlpgrasp bound``."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.best import BestPossible, best_possible
from nlpgrasp.cli.options import AsJson, Script, writable
from nlpgrasp.cli.progress import emit, pair
from nlpgrasp.cli.script import load_problem
from nlpgrasp.quality import Bounds

EVERY = 1.0  # seconds between two lines of progress


def bound_command(
    script: Script,
    gap: Annotated[float, typer.Option("--gap", help="Relative gap to the best grasp met at which to stop.")] = 0.01,
    time_limit: Annotated[float, typer.Option("--time-limit", help="Seconds of wall time.")] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", help="Bound and certificate, for nlpgrasp verify; not kept by default.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Bound mu over all placements of a problem script. Ctrl-C keeps the bound so far."""
    place = None if out is None else writable(out, script)  # before the script runs: it may change the folder
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problem = load_problem(script)
    found = best_possible(problem, gap, time_limit, _Progress() if sys.stderr.isatty() else None)
    if place is not None:
        found.save(place)
    if as_json:
        emit(_data(found, out))
    else:
        _show(problem.name, found, out)
    if found.grasp is None:
        raise typer.Exit(1)


class _Progress:
    """Lines on standard error, one a second: the bound, the best grasp, how much was searched."""

    def __init__(self) -> None:
        self._begun = self._last = time.monotonic()

    def __call__(self, upper: float, mu: Bounds, nodes: int) -> None:
        """Write a line where the last one is old."""
        now = time.monotonic()
        if now - self._last >= EVERY:
            self._last = now
            met = f"best met {mu.lower:.4g}" if mu.lower > 0.0 else "no grasp met"
            sys.stderr.write(f"{now - self._begun:6.1f} s  mu at most {upper:.4g}, {met}, {nodes} nodes\n")
            sys.stderr.flush()


def _show(name: str, found: BestPossible, out: Path | None) -> None:
    typer.echo(f"{name}: mu at most {found.upper:.6g} over all placements")
    if found.grasp is None:
        typer.echo("  no grasp met that resists the task")
    else:
        closed = "closed" if found.closed else "not closed"
        typer.echo(f"  best grasp met: mu certified in {found.mu}, within {found.gap:.2%} of the bound ({closed})")
        for i, (face, point) in enumerate(zip(found.faces, found.grasp.points.tolist(), strict=True)):
            typer.echo(f"  contact {i} on {face} at {', '.join(f'{x:.4g}' for x in point)}")
    for part in found.dropped:
        typer.echo(f"  left out: {part}, which only lowers mu")
    leaves = len(found.certificate["leaves"])
    typer.echo(f"  {found.nodes} nodes, {found.seconds:.1f} s, {leaves} leaves in the certificate")
    if out is not None:
        typer.echo(f"  written to {out}")


def _data(found: BestPossible, out: Path | None) -> dict[str, object]:
    """Return what is found as JSON data, without the certificate."""
    data = found.to_dict()
    kept = {key: data[key] for key in ("upper", "gap", "closed", "nodes", "seconds", "dropped", "grasp")}
    return {**kept, "mu": pair(found.mu), "written": None if out is None else str(out)}
