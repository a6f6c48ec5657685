"""The command ``nlpgrasp export``: solutions in other tools' formats."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import Damping, File, FrictionLoss, Gain, NormalForce, hand_options, writable
from nlpgrasp.common.files import write_bytes
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.interop import ExportFormat

MASS = "With --hand: mass of the object, kilograms; by default the weight that the task carries, or that of water."
OUT = (
    "File to write; by default F with the format's ending, with --frame in a folder beside F which is named after the "
    "frame, as the file is."
)
Mass = Annotated[float | None, typer.Option("--mass", help=MASS)]
Out = Annotated[Path | None, typer.Option("--out", metavar="PATH", help=OUT)]


def export_command(formats: Sequence[ExportFormat]) -> Callable[..., None]:
    """Return the export command, with choices and help from the registered formats."""
    with_hand = _format_alternatives(form.name for form in formats if form.takes_hand)
    formats_by_option = {
        option: _format_alternatives(form.name for form in formats if option in form.takes)
        for option in ("object", "gripper", "joints", "frame")
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
        frame: str | None = None,
    ) -> None:
        """Write a solution for other tools."""
        from nlpgrasp.common.spatial import pose_from_text
        from nlpgrasp.interop import ExportOptions
        from nlpgrasp.interop.registry import format_named
        from nlpgrasp.interop.robot_poses import check_one_frame

        export_format = format_named(to)
        values = {"mass": mass, "gain": gain, "damping": damping, "frictionloss": frictionloss}
        values["normal_force"] = normal_force
        if hand is not None and not export_format.takes_hand:
            raise InputError("--hand", str(hand), f"{with_hand} with it: other formats hold no hand's model")
        scene = hand_options(values, hand, f"of {with_hand}")
        names = {"object": thing, "gripper": gripper, "joints": ", ".join(joint or ()), "frame": frame}
        for option, value in names.items():
            if value and option not in export_format.takes:
                raise InputError(f"--{option.removesuffix('s')}", value, f"{formats_by_option[option]} with it")
        pose = None if frame is None else pose_from_text("--frame", frame)
        options = ExportOptions(hand, ng.HandSceneOptions(**scene), thing, gripper, tuple(joint or ()), pose, _announce)
        solution = ng.GraspSolution.load(file)
        target = export_format.path_beside(file, pose) if out is None else out
        if out is None:
            with suppress(OSError):  # then it cannot be written, which is said below
                target.parent.mkdir(exist_ok=True)
        check_one_frame(target, export_format, pose)
        writable(target, file, ending=Path(f"F{export_format.ending}").suffix)
        write_bytes(target, export_format.export(solution, options))
        typer.echo(f"written to {target}")
        if export_format.pose and solution.gripper_frame_line():
            typer.echo(solution.gripper_frame_line(export_format.pose))
        if hand is not None:
            _describe_assumptions(solution, mass, normal_force)

    _annotate_options(export, formats, with_hand, formats_by_option)
    return export


def _annotate_options(
    export: Callable[..., None], formats: Sequence[ExportFormat], with_hand: str, formats_by_option: Mapping[str, str]
) -> None:
    """Set the help of those options of the export command that depend on the formats."""
    from nlpgrasp.common.spatial import POSE_TEXT

    content = f"Format: {'; '.join(f'{form.name}, {form.content}' for form in formats)}."
    model = f"For {with_hand}: file of the hand, whose own model then takes the place of balls for fingertips."
    export.__annotations__["to"] = Annotated[str, typer.Option("--to", metavar="FORMAT", help=content)]
    export.__annotations__["hand"] = Annotated[Path | None, typer.Option("--hand", metavar="URDF", help=model)]
    descriptions = {
        "thing": ("object", "the other tool's name for the body, a file or a frame."),
        "gripper": ("gripper", "the other tool's name for the hand, a file or a frame."),
        "joint": ("joints", "a joint of the hand; repeat the option in the order that the other tool has."),
        "frame": ("frame", f"pose of the part in the cell, {POSE_TEXT}; poses are in the part's frame without it."),
    }
    for parameter, (option, description) in descriptions.items():
        kind = list[str] | None if parameter == "joint" else str | None
        text = f"For {formats_by_option[option]}: {description}"
        flag = f"--{option.removesuffix('s')}"
        metavar = "POSE" if parameter == "frame" else "NAME"
        export.__annotations__[parameter] = Annotated[kind, typer.Option(flag, metavar=metavar, help=text)]


def _format_alternatives(names: Iterable[str]) -> str:
    """Return names as alternatives: ``a, b or c``."""
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last


def _announce(message: str) -> None:
    """Write a message about a long step to standard error."""
    typer.echo(message, err=True)


def _describe_assumptions(solution: ng.GraspSolution, mass: float | None, normal_force: float | None) -> None:
    """Print the assumptions of an exported scene on the object's mass and the squeeze."""
    from nlpgrasp.simulation.scene_object import object_mass
    from nlpgrasp.solution.squeeze_record import friction_warning, weak_squeeze_warning

    if mass is None:
        assumed_mass = object_mass(solution, None)
        weight = f"{assumed_mass.kilograms:.3g} kg there, {assumed_mass.source}"
        typer.echo(f"the object weighs {weight}: --mass states another")
    for line in (
        weak_squeeze_warning(solution.squeeze, solution.needed, normal_force),
        friction_warning(solution.squeeze),
    ):
        if line:
            typer.echo(line)
