"""Text table of a program's blocks, with sizes, limits, units and equations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.blocks import HAND, Block
from nlpgrasp.nlp.program import Program

Limits = tuple[FloatArray, FloatArray]
FORM = "{:<38} {:>9}  {:<22} {:<5} {}".format
EQUATIONS = {  # of the paper, by the kind of variables
    "position": "p_i of (3.5-1)",
    "normal": "n_i of (3.5-2)",
    HAND: "q of (3.5-16)",
    "beta": "beta of (3.5-4)",
    "forces": "x_j of (2.5-2)",
    "directions": "y_j of (3.4-3)",
    "reach": "phi(y_j | A) of (3.4-3)",
    "wrenches": "w_j of (3.3-4)",
    "face": "which h of (3.5-1)",
}


def program_table(program: Program, added: Iterable[tuple[str, Limits]] = ()) -> list[str]:
    """Return the lines of a program's table.

    Parameters
    ----------
    program : Program
        In SI units.
    added : iterable of (str, pair of arrays)
        Names and limits of user-defined constraints.
    """
    lines = [FORM("variables", "size", "bounds", "unit", "in the paper")]
    lines += [FORM(*row) for row in _block_rows(program.variables, program.bounds)]
    lines += ["", FORM("parameters", "size", "", "", "in the paper")]
    lines += [FORM(*row) for row in _block_rows(program.parameters, None)]
    lines += ["", FORM("constraints", "size", "limits", "", "in the paper")]
    groups: dict[tuple[str, str], list[int]] = {}
    for row in program.rows:
        groups.setdefault((row.kind, row.equation), []).extend(range(row.start, row.stop))
    for (kind, equation), places in groups.items():
        lines.append(FORM(kind, len(places), _interval(program.limits, places), "", equation))
    for name, limits in added:
        lines.append(FORM(name, len(limits[0]), _interval(limits, range(len(limits[0]))), "", "added"))
    return [line.rstrip() for line in lines]


def _block_rows(
    blocks: Sequence[Block], bounds: tuple[FloatArray, FloatArray] | None
) -> list[tuple[str, str, str, str, str]]:
    """Return name, size, bounds, unit and equation of blocks, grouped by kind and size."""
    groups: dict[tuple[str, int], list[Block]] = {}
    for block in blocks:
        groups.setdefault((block.public_name if block.kind == HAND else block.kind, block.size), []).append(block)
    rows = []
    for (name, size), members in groups.items():
        first = members[0]
        several = len(members) > 1
        label = f"{name} {first.index} ... {members[-1].index}" if several else first.public_name
        places = [i for block in members for i in range(block.start, block.stop)]
        limits = "" if bounds is None else _interval(bounds, places)
        shape = f"{len(members)} x {size}" if several else str(size)
        rows.append((label, shape, limits, first.unit, EQUATIONS.get(first.kind, "")))
    return rows


def _interval(limits: tuple[FloatArray, FloatArray], places: Sequence[int] | range) -> str:
    """Return the range of limits over given entries as text."""
    low, high = float(np.min(limits[0][places], initial=np.inf)), float(np.max(limits[1][places], initial=-np.inf))
    if low == high:
        return f"= {low:g}"
    if np.isinf(low) or np.isinf(high):
        return f">= {low:.4g}" if np.isinf(high) else f"<= {high:.4g}"
    return f"[{low:.4g}, {high:.4g}]"
