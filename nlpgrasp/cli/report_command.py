"""The command ``nlpgrasp report``: page or pictures of solutions and problems."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import writable
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.cli.quality_command import complete_file
from nlpgrasp.common.files import file_kind
from nlpgrasp.errors import InputError

FILES = "Solution files; several are compared. Or a script SCRIPT.py: what it asks, before anything is solved."
Files = Annotated[list[Path], typer.Argument(metavar="F.json...", help=FILES)]


def report_command(
    files: Files,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="F.html", help="The page; by default F.html, of a script SCRIPT-problem.html."),
    ] = None,
    png: Annotated[
        bool,
        typer.Option("--png", help="Write pictures instead: the page's scene where a browser is, else a drawing."),
    ] = False,
    save: Annotated[
        bool, typer.Option("--save", help="Add the analyses that are computed for the page to the files.")
    ] = False,
) -> None:
    """Show solutions on one page that opens from disk, or as pictures.

    Analyses that solutions lack are computed for the page. The files stay as they are, but for --save.
    """
    from nlpgrasp.report.pictures import write_noted_pictures
    from nlpgrasp.report.solution_page import write_completed

    if any(file_kind(file) == "a Python script" for file in files):
        _report_problem(files, out, png)
        return
    counts = Counter(file.name for file in files)
    names = [file.name if counts[file.name] == 1 else str(file) for file in files]
    target = files[0].with_suffix(".html") if out is None else out
    writable(target, *files)
    if png:
        from nlpgrasp.common.optional_packages import pyplot

        pyplot("a picture")  # before the work
    if not png:
        completed = {name: complete_file(file, save=save) for name, file in zip(names, files, strict=True)}
        typer.echo(f"written to {write_completed(completed, target)}")
        return
    solutions = {name: ng.GraspSolution.load(file) for name, file in zip(names, files, strict=True)}
    stems = [Path(name).stem for name in solutions]
    for i, solution in enumerate(solutions.values()):
        name_part = stems[i] if stems.count(stems[i]) == 1 else f"{stems[i]}-{i + 1}"
        stem = target.with_suffix("") if len(stems) == 1 else target.with_name(f"{target.stem}-{name_part}")
        for path, note in write_noted_pictures(solution, stem).items():
            typer.echo(f"written to {path}{f' ({note})' if note else ''}")


def _report_problem(files: list[Path], out: Path | None, png: bool) -> None:
    """Write the page that shows a script's problem."""
    from nlpgrasp.report.body_page import write_problem

    if len(files) > 1:
        raise InputError("F.json...", f"{len(files)} files, with a script", "solution files, or one script alone")
    if png:
        raise InputError("--png", f"with {files[0]}, a script", "a solution file with it: a problem has a page alone")
    target = files[0].with_name(f"{files[0].stem}-problem.html") if out is None else out
    writable(target, *files)
    typer.echo(f"written to {write_problem(load_problem(files[0]), target)}")
