"""``nlpgrasp export``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.cli.options import File, writable
from nlpgrasp.common.files import write_bytes, write_text
from nlpgrasp.errors import InputError
from nlpgrasp.interop import contacts_csv, glb, isaac_grasp, mjcf, mjcf_with_hand
from nlpgrasp.solution.solution import GraspSolution


class Format(str, Enum):  # noqa: UP042  (typer shows the values)
    """What a solution can be exported to."""

    CSV = "csv"
    GLB = "glb"
    ISAAC_GRASP = "isaac_grasp"
    MJCF = "mjcf"


ENDINGS = {Format.CSV: ".csv", Format.GLB: ".glb", Format.ISAAC_GRASP: ".yaml", Format.MJCF: ".xml"}


def export_command(
    file: File,
    to: Annotated[
        Format,
        typer.Option("--to", help="Contacts as a table, a scene, a gripper's pose and joints, or a MuJoCo scene."),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="PATH", help="By default F with the format's ending.")
    ] = None,
    hand: Annotated[
        Path | None,
        typer.Option("--hand", metavar="URDF", help="For mjcf: the hand's own model in place of balls for fingertips."),
    ] = None,
) -> None:
    """Write a solution for other tools."""
    if hand is not None and to is not Format.MJCF:
        raise InputError("--hand", str(hand), "mjcf with it: other formats hold no hand's model")
    solution = GraspSolution.load(file)
    target = file.with_suffix(ENDINGS[to]) if out is None else out
    writable(target, file)
    if to is Format.GLB:
        write_bytes(target, glb(solution))
    elif to is Format.CSV:
        write_text(target, contacts_csv(solution))
    elif to is Format.MJCF:
        write_text(target, mjcf(solution) if hand is None else mjcf_with_hand(solution, hand))
    else:
        write_text(target, isaac_grasp({"grasp_0": solution}))
    typer.echo(f"written to {target}")
