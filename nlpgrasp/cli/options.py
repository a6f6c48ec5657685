"""Options shared by several commands, with their checks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.common.files import writable_place
from nlpgrasp.errors import InputError

Script = Annotated[Path, typer.Argument(metavar="SCRIPT", help="Python file with a function problem().")]
File = Annotated[Path, typer.Argument(metavar="F.json", help="Solution file.")]
Folders = Annotated[
    list[Path] | None,
    typer.Option("--folder", help="Where the file's mesh and URDF are looked for, after its own folder; repeatable."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Write JSON lines to standard output instead of text.")]
Gain = Annotated[
    float | None,
    typer.Option(
        "--gain", help="With --hand: gain of the servos of turning joints, N m / rad; by default the solution's."
    ),
]
Damping = Annotated[
    float | None, typer.Option("--damping", help="With --hand: damping of the joints, N m s / rad; 0.1 by default.")
]
FrictionLoss = Annotated[
    float | None,
    typer.Option("--frictionloss", help="With --hand: dry friction of the joints, N m; 0.005 by default."),
]
NormalForce = Annotated[
    float | None,
    typer.Option(
        "--normal-force",
        help="With --hand: the force that each finger presses with at least, newtons; by default the solution's.",
    ),
]
Rtol = Annotated[float, typer.Option("--rtol", help="Relative gap of the certificate.")]


def writable(target: Path, *sources: Path, ending: str = "") -> Path:
    """Return the absolute path of a result file, refusing one that could not or should not be written."""
    if target.resolve() in [source.resolve() for source in sources]:
        raise InputError("--out", f"{target} (the script or file itself)", "another file")
    return writable_place("--out", target, ending)
