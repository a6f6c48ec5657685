"""The command ``nlpgrasp hand``: inspection of a hand before a solve."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nlpgrasp.cli.hand.arguments import described, direction_of, fingertips_of, link_of
from nlpgrasp.cli.options import writable
from nlpgrasp.common.shown.face import opened
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.hands.base import Hand
    from nlpgrasp.hands.inspection.inspected import Inspected

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
        hand = _hand(source, preset, palm, fingertip or [], approach)
    from nlpgrasp.hands.inspection.inspection import inspect
    from nlpgrasp.report import write_hand

    found = inspect(hand)
    page = write_hand(found, target)
    typer.echo("\n".join(found.lines))
    typer.echo(f"written to {page}")
    if show:
        opened(page)


def _hand(
    source: Path, preset: str | None, palm: str | None, fingertip: list[str], approach: str | None
) -> Hand | Inspected:
    """Return the hand that is shown."""
    name, path = described(source, preset)
    if name is not None:
        for option, given in (("--fingertip", ", ".join(fingertip)), ("--approach", approach)):
            if given:
                raise InputError(option, given, f"none with the preset {name}, which has its own")
        from nlpgrasp.hands.presets import PRESETS

        make = PRESETS[name]
        if palm is None:
            return make(path)
        return make(path, palm=palm if path is None else link_of(path, palm, "--palm"))
    base = None if palm is None else link_of(source, palm, "--palm")
    faces = direction_of(approach)
    if not fingertip:
        from nlpgrasp.hands.inspection.inspected import without_fingertips

        return without_fingertips(source, base, faces)
    from nlpgrasp import URDFHand

    return URDFHand.load(source, fingertips_of(source, base, fingertip), palm=base, approach=faces)
