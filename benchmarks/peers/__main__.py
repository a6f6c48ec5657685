"""Command line of the study: ``python -m benchmarks.peers [BODY ...]``.

``--tables`` only writes tables and picture anew.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from benchmarks.peers.cases import CASES
from benchmarks.peers.picture import draw
from benchmarks.peers.results import RESULTS, read
from benchmarks.peers.run import run
from benchmarks.peers.tables import by_method, write_block

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def main(arguments: list[str]) -> None:
    """Run the study on all bodies or on the named ones, and write tables and picture."""
    bodies = [argument for argument in arguments if argument != "--tables"]
    unknown = [body for body in bodies if body not in CASES]
    if unknown:
        sys.exit(f"{unknown[0]} is no body of the study: {', '.join(CASES)}")
    if "--tables" not in arguments:
        # some of the bodies alone are a trial, and leave the study's file as it is
        run(RESULTS if not bodies else ROOT / "build" / "peers.csv", bodies or tuple(CASES))
    if not bodies:
        rows = read(RESULTS)
        write_block(DOCS / "comparison.md", rows)
        print(by_method(rows))
        if find_spec("matplotlib") is None:
            print("no picture: no matplotlib here")
        else:
            draw(rows, DOCS / "pictures" / "peers.svg")


if __name__ == "__main__":
    main(sys.argv[1:])
