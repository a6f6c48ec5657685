"""Finger forces for the task at full size, as HTML."""

from __future__ import annotations

from html import escape

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.shown.text import capital
from nlpgrasp.report.table import table
from nlpgrasp.solution.solution import GraspSolution


def forces_needed(solution: GraspSolution) -> str:
    """Return the required forces as text and by finger, as HTML; empty where a file does not state them."""
    needed = solution.needed
    if needed is None:
        return ""
    over = needed.is_within(solution.max_force) is False
    first, *_, last = (f"{capital(line)}." for line in solution.needed_lines())
    kind = ' class="status failed"' if over else ""
    columns = zip(needed.size, needed.normal, needed.largest, strict=True)
    rows = [[f"{i}", *(f"{rounded(force)} N" for force in forces)] for i, forces in enumerate(columns)]
    heads = ["Finger", "Force", "Normal force", "Largest force of any wrench computed"]
    drawn = table("Least finger forces for the hardest wrench of the task as given", heads, rows)
    return f"<h3>Forces for the task as given</h3><p>{escape(first)}</p><p{kind}>{escape(last)}</p>{drawn}"
