"""The command ``nlpgrasp hand``: see a hand before anything is solved with it."""

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
    Path, typer.Argument(metavar="URDF", help="URDF file; or the name of a preset, whose URDF robot_descriptions has.")
]


def hand_command(
    source: Source,
    palm: Annotated[
        str | None, typer.Option("--palm", metavar="LINK", help="What all else hangs from; the root by default.")
    ] = None,
    fingertip: Annotated[
        list[str] | None,
        typer.Option(
            "--fingertip",
            metavar="LINK[=RADIUS]",
            help="A fingertip and its radius, metres; by default as thick as the link's shape. Repeatable, in order.",
        ),
    ] = None,
    preset: Annotated[
        str | None, typer.Option("--preset", help="Whose fingertips the URDF's hand has: allegro, panda, ...")
    ] = None,
    approach: Annotated[
        str | None,
        typer.Option("--approach", metavar="X,Y,Z", help="Where the palm faces, palm frame; 0,0,1 by default."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="F.html", help="The page; by default URDF's name with .html.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser, where there is one.")
    ] = True,
) -> None:
    """Show a hand on one page: links, fingertips, joints to move, which fingertips meet, what its file lacks.

    The same findings are printed; those after an exclamation mark may make grasps come out wrong.
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
