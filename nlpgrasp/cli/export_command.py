"""The command ``nlpgrasp export``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import Damping, File, FrictionLoss, Gain, NormalForce, writable
from nlpgrasp.common.files import write_bytes
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.interop import ExportFormat

MASS = "With --hand: mass of the object, kilograms; by default the weight that the task carries, or that of water."
Mass = Annotated[float | None, typer.Option("--mass", help=MASS)]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="PATH", help="File to write; by default F with the format's ending.")
]


def export_command(formats: Sequence[ExportFormat]) -> Callable[..., None]:
    """Return the command, whose choices and help are those of the formats."""
    content = f"Format: {'; '.join(f'{given.name}, {given.content}' for given in formats)}."
    with_hand = _format_alternatives(given.name for given in formats if given.takes_hand)
    model = f"For {with_hand}: file of the hand, whose own model then takes the place of balls for fingertips."
    takers = {
        field: _format_alternatives(f.name for f in formats if field in f.takes)
        for field in ("object", "gripper", "joints")
    }

    def export(
        file: File,
        to: str,
        out: Out = None,
        hand: Path | None = None,
        mass: Mass = None,
        gain: Gain = None,
        damping: Damping = None,
        frictionloss: FrictionLoss = None,
        normal_force: NormalForce = None,
        thing: str | None = None,
        gripper: str | None = None,
        joint: list[str] | None = None,
    ) -> None:
        """Write a solution for other tools."""
        from nlpgrasp.interop import ExportOptions
        from nlpgrasp.interop.registry import format_named

        chosen = format_named(to)
        if hand is not None and not chosen.takes_hand:
            raise InputError("--hand", str(hand), f"{with_hand} with it: other formats hold no hand's model")
        stated = {"mass": mass, "gain": gain, "damping": damping, "frictionloss": frictionloss}
        scene = {name: value for name, value in {**stated, "normal_force": normal_force}.items() if value is not None}
        if scene and hand is None:
            name = next(iter(scene))
            raise InputError(f"--{name.replace('_', '-')}", scene[name], f"only with --hand, of {with_hand}")
        given = {"object": thing, "gripper": gripper, "joints": ", ".join(joint or ())}
        for field, value in given.items():
            if value and field not in chosen.takes:
                raise InputError(f"--{field.removesuffix('s')}", value, f"{takers[field]} with it")
        options = ExportOptions(hand, ng.HandSceneOptions(**scene), thing, gripper, tuple(joint or ()), _announce)
        solution = ng.GraspSolution.load(file)
        target = file.with_suffix(chosen.ending) if out is None else out
        writable(target, file, ending=Path(f"F{chosen.ending}").suffix)
        write_bytes(target, chosen.export(solution, options))
        typer.echo(f"written to {target}")
        if hand is not None:
            _describe_assumptions(solution, mass, normal_force)

    export.__annotations__["to"] = Annotated[str, typer.Option("--to", metavar="FORMAT", help=content)]
    export.__annotations__["hand"] = Annotated[Path | None, typer.Option("--hand", metavar="URDF", help=model)]
    helps = {
        "thing": (
            "--object",
            "NAME",
            f"For {takers['object']}: the other tool's name for the body, a file or a frame.",
        ),
        "gripper": (
            "--gripper",
            "NAME",
            f"For {takers['gripper']}: the other tool's name for the hand, a file or a frame.",
        ),
        "joint": (
            "--joint",
            "NAME",
            f"For {takers['joints']}: a joint of the hand; repeat the option in the order that the other tool has.",
        ),
    }
    for field, (flag, metavar, told) in helps.items():
        kind = list[str] | None if field == "joint" else str | None
        export.__annotations__[field] = Annotated[kind, typer.Option(flag, metavar=metavar, help=told)]
    return export


def _format_alternatives(names: Iterable[str]) -> str:
    """Return names as alternatives: ``a, b or c``."""
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last


def _announce(words: str) -> None:
    """Say on standard error what is about to take long."""
    typer.echo(words, err=True)


def _describe_assumptions(solution: ng.GraspSolution, mass: float | None, normal_force: float | None) -> None:
    """Say what a scene takes for granted: the object's mass, and how hard the fingers press."""
    from nlpgrasp.simulation.scene_object import object_mass
    from nlpgrasp.solution.squeeze_record import friction_warning, too_weak

    if mass is None:
        found = object_mass(solution, None)
        typer.echo(f"the object weighs {found.kilograms:.3g} kg there, {found.source}: --mass states another")
    for line in (too_weak(solution.squeeze, solution.needed, normal_force), friction_warning(solution.squeeze)):
        if line:
            typer.echo(line)
