"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Script = Annotated[Path, typer.Argument(metavar="SCRIPT", help="Python file with a function problem().")]
File = Annotated[Path, typer.Argument(metavar="F.json", help="Solution file.")]
AsJson = Annotated[bool, typer.Option("--json", help="JSON lines on standard output instead of text.")]
Rtol = Annotated[float, typer.Option("--rtol", help="Relative gap of the certificate.")]
