"""``nlpgrasp export``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.atomic import write_bytes, write_text
from nlpgrasp.cli.options import File, writable
from nlpgrasp.interop import contacts_csv, glb, isaac_grasp
from nlpgrasp.solution import GraspSolution


class Format(str, Enum):  # noqa: UP042  (typer shows the values)
    """What a solution can be exported to."""

    CSV = "csv"
    GLB = "glb"
    ISAAC_GRASP = "isaac_grasp"


ENDINGS = {Format.CSV: ".csv", Format.GLB: ".glb", Format.ISAAC_GRASP: ".yaml"}


def export_command(
    file: File,
    to: Annotated[Format, typer.Option("--to", help="Contacts as a table, a scene, or a gripper's pose and joints.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="PATH", help="By default F with the format's ending.")
    ] = None,
) -> None:
    """Write a solution for other tools."""
    target = file.with_suffix(ENDINGS[to]) if out is None else out
    writable(target, file)
    solution = GraspSolution.load(file)
    if to is Format.GLB:
        write_bytes(target, glb(solution))
    elif to is Format.CSV:
        write_text(target, contacts_csv(solution))
    else:
        write_text(target, isaac_grasp({"grasp_0": solution}))
    typer.echo(f"written to {target}")
