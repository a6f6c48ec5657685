"""What the fingers press for the task as it was given, as HTML."""

from __future__ import annotations

from html import escape

from nlpgrasp.report.table import table
from nlpgrasp.solution.solution import GraspSolution


def forces_needed(solution: GraspSolution) -> str:
    """Return what the whole task needs in words, and finger by finger; nothing where a file does not say it."""
    needed = solution.needed
    if needed is None:
        return ""
    over = needed.is_within(solution.max_force) is False
    words = [f"{line[:1].upper()}{line[1:]}." for line in solution.needed_lines()]
    told = "".join(f"<p>{escape(line)}</p>" for line in words[:-1])
    kind = ' class="status failed"' if over else ""
    rows = [
        [f"{i}", f"{size:.4g} N", f"{normal:.4g} N", f"{largest:.4g} N"]
        for i, (size, normal, largest) in enumerate(zip(needed.size, needed.normal, needed.largest, strict=True))
    ]
    heads = ["Finger", "Force", "Normal force", "Largest force of any wrench computed"]
    drawn = table("Least finger forces for the hardest wrench of the task as given", heads, rows)
    return f"<h3>Forces for the task as given</h3>{told}<p{kind}>{escape(words[-1])}</p>{drawn}"
