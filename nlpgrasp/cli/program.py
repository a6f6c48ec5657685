"""The command ``nlpgrasp program``: the nonlinear program of a problem script as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.options import Script, writable
from nlpgrasp.cli.script import load_problem


def program_command(
    script: Script,
    transcription: Annotated[
        str, typer.Option("--transcription", metavar="support|vertex", help="Containment: outer or inner.")
    ] = "support",
    forces: Annotated[
        bool, typer.Option("--forces/--no-forces", help="Finger forces as variables, or the support in closed form.")
    ] = True,
    spy: Annotated[
        Path | None, typer.Option("--spy", metavar="F.png", help="Picture of the Jacobian's sparsity.")
    ] = None,
) -> None:
    """Print the program (3.5-4) of a problem script as a table: variables, parameters, constraints, equations."""
    place = None if spy is None else writable(spy, script)  # before the script runs: it may change the folder
    if place is not None:
        from nlpgrasp.common.extras.pyplot import pyplot

        pyplot("a picture")  # before the work
    problem = load_problem(script)
    program = ng.formulate(problem, transcription, forces=forces)
    if place is not None:
        from nlpgrasp.report.sparsity import write_sparsity

        write_sparsity(program, place)
    typer.echo(str(program))
    if spy is not None:
        typer.echo(f"picture written to {spy}")
