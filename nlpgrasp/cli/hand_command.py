"""The command ``nlpgrasp hand``: inspection of a hand before a solve."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nlpgrasp.cli.console import writable
from nlpgrasp.common.display import open_page
from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.common.validation import NEAREST, format_known_names, similar_names
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.hands.base import Hand
    from nlpgrasp.hands.inspection import InspectedHand
    from nlpgrasp.hands.tips import Tip

ANY_OVERHANG = 1e9  # metres: a fingertip anywhere is shown, with a grave finding where it is off its link

Source = Annotated[
    Path,
    typer.Argument(
        metavar="URDF", help="A URDF or MJCF file, or the name of a preset (its URDF is fetched by robot_descriptions)."
    ),
]


def hand_command(
    source: Source,
    palm: Annotated[
        str | None, typer.Option("--palm", metavar="LINK", help="Palm link (default: the root link).")
    ] = None,
    fingertip: Annotated[
        list[str] | None,
        typer.Option(
            "--fingertip",
            metavar="LINK[=RADIUS]",
            help="Fingertip link and radius in metres (default: from its collision shape). Repeat for each contact.",
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            "--preset", metavar="NAME", help="Preset that supplies fingertips, palm and limits, such as allegro."
        ),
    ] = None,
    approach: Annotated[
        str | None,
        typer.Option(
            "--approach",
            metavar="X,Y,Z",
            help="Direction in which the palm faces, in the palm's frame (default: 0,0,1).",
        ),
    ] = None,
    scale: Annotated[
        float, typer.Option("--scale", metavar="S", help="Factor on the meshes of a URDF: 0.001 for millimetres.")
    ] = 1.0,
    degrees: Annotated[bool, typer.Option("--degrees", help="Limits of the URDF's joints are degrees.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="F.html", help="Where to write the page (default: the name of the URDF with .html)."
        ),
    ] = None,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser, if there is one.")] = True,
) -> None:
    """Show a hand on one page: its links, fingertips and joints, which fingertips can meet, and what its file lacks.

    The findings are printed too. A finding marked with ! can make grasps wrong.
    """
    target = Path(f"{source.stem}.html") if out is None else out
    writable(target, source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the findings say what they say
        hand = _load_hand(source, preset, palm, fingertip or [], approach, UrdfUnits(scale, degrees))
    from nlpgrasp.hands.inspection import inspect
    from nlpgrasp.report import write_hand

    inspection = inspect(hand)
    page = write_hand(inspection, target)
    typer.echo("\n".join(inspection.lines))
    typer.echo(f"written to {page}")
    if show:
        open_page(page)


def _load_hand(
    source: Path,
    preset: str | None,
    palm: str | None,
    fingertip: list[str],
    approach: str | None,
    units: UrdfUnits,
) -> Hand | InspectedHand:
    """Load the hand of a file or a preset."""
    name, path = resolve_preset(source, preset)
    if name is not None:
        for option, value in (("--fingertip", ", ".join(fingertip)), ("--approach", approach)):
            if value:
                raise InputError(option, value, f"none with the preset {name}, which has its own")
        from nlpgrasp.hands.presets import Options, load_preset

        options = Options(tip_overhang=ANY_OVERHANG, scale=units.scale, degrees=units.degrees)
        if palm is not None:
            options["palm"] = palm if path is None else check_link(path, palm, "--palm")
        return load_preset(name, path, **options)
    palm_link = None if palm is None else check_link(source, palm, "--palm")
    direction = parse_palm_direction(approach)
    if not fingertip:
        from nlpgrasp.hands.inspection import inspect_without_tips

        return inspect_without_tips(source, palm_link, direction, units)
    from nlpgrasp import URDFHand

    tips = parse_fingertips(source, palm_link, fingertip)
    return URDFHand.load(
        source,
        tips,
        palm=palm_link,
        approach=direction,
        tip_overhang=ANY_OVERHANG,
        scale=units.scale,
        degrees=units.degrees,
    )


def resolve_preset(source: Path, preset: str | None) -> tuple[str | None, Path | None]:
    """Return the name of the preset and the path of the URDF.

    The name is ``None`` without a preset; the path is ``None`` if the URDF has to be fetched.

    Raises
    ------
    InputError
        On the name of no preset, and where there is neither a file nor a preset.
    """
    from nlpgrasp.hands.presets import PRESETS

    if preset is not None:
        if preset not in PRESETS:
            raise InputError("--preset", preset, f"one of {format_known_names([preset], PRESETS)}")
        return preset, source
    if not source.exists():
        if str(source) in PRESETS:
            return str(source), None
        allowed = f"a URDF file that exists, or one of {format_known_names([source], PRESETS)}"
        raise InputError("URDF", str(source), allowed)
    return None, source


def check_link(source: Path, name: str, option: str, allowed: Sequence[str] | None = None) -> str:
    """Return a link's name; raise if the robot has no such link.

    Parameters
    ----------
    source : Path
    name, option : str
        What was given, and where.
    allowed : sequence of str, optional
        The links that are allowed; all of the file when left out.
    """
    from nlpgrasp.hands.robot_file import robot_links

    names = list(robot_links(source)) if allowed is None else list(allowed)
    if name not in names:
        examples = ", ".join((similar_names(name, names) or names)[:NEAREST])
        raise InputError(option, name, f"a link of {source.name}, such as {examples}")
    return name


def parse_palm_direction(text: str | None) -> list[float]:
    """Parse the palm's direction from text X,Y,Z; the default is the z axis."""
    try:
        direction = [0.0, 0.0, 1.0] if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        direction = []
    if len(direction) != 3 or not any(direction):
        raise InputError("--approach", text, "a direction as three numbers, such as 1,0,0")
    return direction


def parse_fingertips(
    source: Path, palm: str | None, texts: Sequence[str]
) -> Mapping[str, float | Tip | Sequence[Tip] | None]:
    """Parse fingertips from texts LINK or LINK=RADIUS, and return link and patch of each.

    Without a radius the fingertip is the link's only collision sphere or capsule, or else fitted to its shapes.

    Raises
    ------
    InputError
        On links that are not there or stand twice, radii that are none, and links without a shape and a radius.
    """
    from nlpgrasp.common.validation import number
    from nlpgrasp.hands.robot_file import read_robot

    robot = read_robot(source, palm)
    tips: dict[str, float | Tip | Sequence[Tip] | None] = {}
    for text in texts:
        name, separator, radius = text.partition("=") if text not in robot.links else (text, "", "")
        link = check_link(source, name, "--fingertip", robot.links)
        if link in tips:
            raise InputError("--fingertip", f"{link} twice", "each link once")
        if separator:
            tips[link] = number(f"--fingertip {link}", _parse_number(link, radius), above=0.0)
            continue
        if not robot.group_shapes(link):
            problem = f"{link}, which has no collision shape"
            raise InputError("--fingertip", problem, f"its radius: {link}=0.01 (metres)")
        tips[link] = None
    return tips


def _parse_number(link: str, text: str) -> float:
    """Parse a fingertip's radius."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--fingertip {link}", text or "nothing", "a radius in metres") from None
