"""Solution report: one self-contained HTML page with the content of solution files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.common.shown.numbers import typeset
from nlpgrasp.experiments.found.compare import compare
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.solution import sections
from nlpgrasp.report.solution.complete import completed
from nlpgrasp.report.solution.panel import verdict
from nlpgrasp.report.solution.starts import starts
from nlpgrasp.report.solution.strip import every, replacements, scenes, strip
from nlpgrasp.report.solution.worth import worth
from nlpgrasp.solution.solution import GraspSolution


def write_report(solutions: Mapping[str, GraspSolution], path: str | Path) -> Path:
    """Write a page that shows solutions; several are compared first.

    The page is self-contained and needs no network. Missing analyses are computed as far as the problems are known, and
    named on the page.

    Parameters
    ----------
    solutions : mapping of str to GraspSolution
        Solutions by their names on the page, such as their files'.
    path : str or Path
        Path of the page; an existing file is replaced.

    Raises
    ------
    InputError
        Without solutions, or on a path that cannot be written.
    """
    compare(solutions)  # refuses other objects than solutions
    every_completed = [completed(solution) for solution in solutions.values()]
    solutions = dict(zip(solutions, (solution for solution, _ in every_completed), strict=True))
    compared, notes = compare(solutions), [note for _, note in every_completed]
    title = ", ".join(s.name for s in solutions.values())
    body = []
    if len(solutions) > 1:
        body += [f"<h1>{len(solutions)} grasps compared</h1>", sections.comparison(compared, solutions)]
    heading = "h1" if len(solutions) == 1 else "h2"
    each = zip(solutions.items(), notes, strict=True)
    body += [_solution(name, solution, i, heading, note) for i, ((name, solution), note) in enumerate(each)]
    return write_text(path, page(title, style("report.css"), body, ICON, viewer()))


def write_own(solution: GraspSolution, path: str | Path) -> Path:
    """Write the page of one solution, under the name of its file.

    Parameters
    ----------
    solution : GraspSolution
    path : str or Path

    Raises
    ------
    InputError
        On a path that cannot be written.
    """
    return write_report({Path(path).name: solution}, path)


def _solution(name: str, solution: GraspSolution, number: int, heading: str, note: str) -> str:
    """Return the section of one solution."""
    shown, coloured = every(solution), worth(solution)
    first = shown[0]
    data = {
        "scenes": scenes(shown),
        **first.numbers(),
        "grasps": replacements(shown) if len(shown) > 1 else [],
        "worth": coloured,
    }
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    told, tone = verdict(solution)
    parts = [
        f'<section data-grasp aria-labelledby="name{number}">',
        f'<header><{heading} id="name{number}">{escape(solution.name or name)}</{heading}>'
        f'<span class="pill {tone}">{escape(told)}</span><span class="file">{escape(name)}</span></header>',
        f'<p class="asked">{escape(typeset(sections.asked(solution)))}</p>',
        '<div class="first">',
        sections.stage(solution, first.labels, number, first.scene, strip(shown, number), worth=coloured is not None),
        first.panel,
        "</div>",
        first.tables,
        sections.wrench_space(solution),
        starts(solution),
        sections.inputs(name, solution),
        f'<p class="note">{escape(note)}</p>' if note else "",
        f'<script type="application/json">{text}</script></section>',
    ]
    return "\n".join(part for part in parts if part)
