"""The commands ``nlpgrasp check`` and ``nlpgrasp prove``: proofs of bounds on mu."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, File, Rtol, writable, write_json_line

ProofFile = Annotated[Path, typer.Argument(metavar="F.proof", help="Proof file.")]


def check_command(
    file: ProofFile,
    exact: Annotated[
        bool, typer.Option("--exact", help="By the checker in rational arithmetic, some hundred times slower.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check a proof of bounds on mu, which stands alone. Exit code: 0 if it holds, 1 if not, 2 on bad input."""
    checked = ng.check_proof(file, "python" if exact else None)
    if as_json:
        mu = [checked.lower, checked.upper] if checked else None
        write_json_line({"proved": bool(checked), "mu": mu, "reason": checked.reason, "checker": checked.checker})
    else:
        typer.echo(str(checked))
    if not checked:
        raise typer.Exit(1)


def prove_command(
    file: File,
    out: Annotated[Path | None, typer.Option("--out", help="Proof; F.proof for F.json by default.")] = None,
    rtol: Rtol = 0.01,
) -> None:
    """Write a proof of the bounds on mu of a solution file's grasp, which `nlpgrasp verify` finds beside the file."""
    solution = ng.GraspSolution.load(file)
    target = file.with_suffix(".proof") if out is None else out
    bounds = solution.write_proof(writable(target, file), rtol)
    typer.echo(f"{solution.name}: {bounds.kind} proved in {bounds}; written to {target}")
