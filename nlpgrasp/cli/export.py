"""The command ``nlpgrasp export``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, EnumType
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.options import Damping, File, FrictionLoss, Gain, NormalForce, writable
from nlpgrasp.common.files import write_bytes
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.interop import ExportFormat

Mass = Annotated[float | None, typer.Option("--mass", help="With --hand: of the object, kg; of water by default.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="PATH", help="By default F with the format's ending.")]


def export_command(formats: Sequence[ExportFormat]) -> Callable[..., None]:
    """Return the command, whose choices and help are those of the formats."""
    names = EnumType.__call__(Enum, "Format", [(given.name, given.name) for given in formats])  # typer shows the values
    *first, last = [given.content for given in formats]
    content = f"{', '.join(first)}, or {last}."
    with_hand = " or ".join(given.name for given in formats if given.takes_hand)
    model = f"For {with_hand}: the hand's own model in place of balls for fingertips."

    def export(
        file: File,
        to: Enum,
        out: Out = None,
        hand: Path | None = None,
        mass: Mass = None,
        gain: Gain = None,
        damping: Damping = None,
        frictionloss: FrictionLoss = None,
        normal_force: NormalForce = None,
    ) -> None:
        """Write a solution for other tools."""
        from nlpgrasp.interop import ExportOptions
        from nlpgrasp.interop.registry import format_named

        chosen = format_named(to.value)
        if hand is not None and not chosen.takes_hand:
            raise InputError("--hand", str(hand), f"{with_hand} with it: other formats hold no hand's model")
        stated = {"mass": mass, "gain": gain, "damping": damping, "frictionloss": frictionloss}
        scene = {name: value for name, value in {**stated, "normal_force": normal_force}.items() if value is not None}
        if scene and hand is None:
            name = next(iter(scene))
            raise InputError(f"--{name.replace('_', '-')}", scene[name], f"only with --hand, of {with_hand}")
        solution = ng.GraspSolution.load(file)
        target = file.with_suffix(chosen.ending) if out is None else out
        writable(target, file)
        write_bytes(target, chosen.export(solution, ExportOptions(hand, ng.HandSceneOptions(**scene))))
        typer.echo(f"written to {target}")

    chosen_by = typer.Option("--to", help=content[0].upper() + content[1:])
    export.__annotations__["to"] = Annotated[names, chosen_by]
    export.__annotations__["hand"] = Annotated[Path | None, typer.Option("--hand", metavar="URDF", help=model)]
    return export
