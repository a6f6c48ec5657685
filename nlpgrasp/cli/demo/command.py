"""The command ``nlpgrasp demo``: a first grasp with its report page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.analyses import add_analyses, asked_analyses
from nlpgrasp.cli.options import writable
from nlpgrasp.cli.progress import Reporter
from nlpgrasp.common.shown.face import opened

TOLD = """A box of 80 x 40 x 40 mm stands on a table. Four round fingertips of 8 mm, friction 0.6, are to exert
10 N along z, 5 N across and 0.2 N m of torque on it, either way. Where should they touch it?
"""


def demo_command(
    out: Annotated[
        Path, typer.Option("--out", metavar="F.json", help="The grasp found; the page goes beside it.")
    ] = Path("demo.json"),
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser, where there is one.")
    ] = True,
) -> None:
    """Solve README's example, certify and verify the grasp, and open a page that shows it: seconds."""
    page = out.with_suffix(".html")
    place, _ = writable(out), writable(page, out)
    typer.echo(TOLD)
    from nlpgrasp.cli.demo.example import STARTS, problem

    with Reporter("demo", STARTS, False) as reporter:
        solution = ng.solve(problem(), STARTS, progress=reporter.start_done)
    solution.save(place)
    typer.echo(str(solution))
    verification = ng.verify(place)
    typer.echo(verification.verdict)
    if solution.known_problem is not None:
        names = asked_analyses(None, False, solution.known_problem.hand)
        solution = add_analyses(solution, names, place, False)
    from nlpgrasp.report import write_report

    write_report({out.name: solution}, page)
    typer.echo(f"\nwritten to {out} and {page}")
    if show:
        opened(page)
    if not (solution.success and verification):
        raise typer.Exit(1)
