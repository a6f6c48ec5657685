"""The command ``nlpgrasp report``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.cli.options import writable
from nlpgrasp.cli.quality import complete

Files = Annotated[list[Path], typer.Argument(metavar="F.json...", help="Solution files; several are compared.")]


def report_command(
    files: Files,
    out: Annotated[Path | None, typer.Option("--out", metavar="F.html", help="The page; by default F.html.")] = None,
    png: Annotated[
        bool, typer.Option("--png", help="Write pictures beside the page instead: no browser needed.")
    ] = False,
) -> None:
    """Show solutions on one page that opens from disk, or as pictures.

    To solutions of ``solve --quick`` what was left out is added first, in the same files.
    """
    from nlpgrasp.report import write_pictures, write_report

    often = Counter(file.name for file in files)
    names = [file.name if often[file.name] == 1 else str(file) for file in files]
    target = files[0].with_suffix(".html") if out is None else out
    writable(target, *files)
    if png:
        from nlpgrasp.common.extras.pyplot import pyplot

        pyplot("a picture")  # before the work
    solutions = {name: complete(file) for name, file in zip(names, files, strict=True)}
    if not png:
        typer.echo(f"written to {write_report(solutions, target)}")
        return
    stems = [Path(name).stem for name in solutions]
    for i, solution in enumerate(solutions.values()):
        own = stems[i] if stems.count(stems[i]) == 1 else f"{stems[i]}-{i + 1}"
        stem = target.with_suffix("") if len(stems) == 1 else target.with_name(f"{target.stem}-{own}")
        for path in write_pictures(solution, stem):
            typer.echo(f"written to {path}")
