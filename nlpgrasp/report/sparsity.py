"""Picture of the sparsity of a program's constraint Jacobian, by blocks of variables and constraints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.extras.pyplot import pyplot, write_figure
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.nlp import Formulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_sparsity(program: Formulation, path: str | Path) -> Path:
    """Write a picture of the sparsity pattern of a program's constraint Jacobian, and return its path.

    Parameters
    ----------
    program : Formulation
    path : str or Path
        Of a PNG file.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When the file cannot be written.
    """
    entries, rows, columns = program.sparsity()
    figure: Figure = pyplot("a picture").figure(
        figsize=(9.0, 9.0 * min(1.2, len(rows) / len(columns)) + 1.0), layout="constrained"
    )
    axes = figure.add_subplot()
    down, across = np.nonzero(entries)
    axes.plot(
        across,
        down,
        linestyle="none",
        marker="s",
        markersize=max(0.4, 300.0 / max(entries.shape)),
        color=COLOURS["force"],
    )
    for names, lines, ticks in (
        (rows, axes.axhline, axes.set_yticks),
        (columns, axes.axvline, axes.set_xticks),
    ):
        starts, kinds = _groups(names)
        for start in starts[1:]:
            lines(start - 0.5, color="0.8", linewidth=0.6)
        middles = (np.array(starts) + np.array([*starts[1:], len(names)]) - 1) / 2.0
        ticks(middles, kinds, rotation=0 if names is rows else 90, fontsize=8)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_title(f"{int(entries.sum())} of {entries.size} entries of the Jacobian", fontsize=10)
    return write_figure(figure, path)


def _groups(names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the starts of runs of names of one kind, and the kinds."""
    kinds = [name.split(",")[0].rstrip(" 0123456789") for name in names]
    starts = [i for i, kind in enumerate(kinds) if i == 0 or kinds[i - 1] != kind]
    return starts, [kinds[i] for i in starts]
