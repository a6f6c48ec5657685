"""The report: one page that opens from disk, with all that a solution file says."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.experiments.found.compare import compare
from nlpgrasp.report.frame import page
from nlpgrasp.report.solution import sections
from nlpgrasp.report.solution.chosen_wrenches import chosen_wrenches, force_words
from nlpgrasp.report.solution.needed import forces_needed
from nlpgrasp.report.solution.scene import scene
from nlpgrasp.report.solution.worth import worth_colours
from nlpgrasp.solution.solution import GraspSolution


def write_report(solutions: Mapping[str, GraspSolution], path: str | Path) -> Path:
    """Write a page that shows solutions; several of them are compared first.

    The page needs no network: plotly is inside it.

    Parameters
    ----------
    solutions : mapping of str to GraspSolution
        By the names they have on the page, such as their files'.
    path : str or Path

    Raises
    ------
    InputError
        On no solutions, or a path that cannot be written.
    """
    compared = compare(solutions)  # refuses what are no solutions
    title = "nlpgrasp: " + ", ".join(s.name for s in solutions.values())
    body = [f"<h1>{escape(title)}</h1>"]
    if len(solutions) > 1:
        body.append(sections.comparison(compared))
    body += [_solution(name, solution, i) for i, (name, solution) in enumerate(solutions.items())]
    scripts = "".join(f"<script>{_resource(name)}</script>" for name in ("vendor/plotly-gl3d.min.js", "report.js"))
    text = page(title, _resource("report.css"), body, '<link rel="icon" href="data:,">', scripts)
    return write_text(path, text)


def _solution(name: str, solution: GraspSolution, number: int) -> str:
    """Return the section of one solution."""
    chosen = chosen_wrenches(solution)
    traces, arrows = scene(solution, chosen)
    grasp = solution.grasp
    labels = [c.label for c in chosen]
    fingers = [force_words(grasp, c.forces) for c in chosen] if grasp is not None else []
    worth = worth_colours(solution)
    data = {"traces": traces, "arrows": arrows, "labels": labels, "fingers": fingers, "worth": worth}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = [
        f'<section data-grasp aria-labelledby="name{number}">',
        f'<h2 id="name{number}">{escape(name)}: {escape(solution.name)}</h2>',
        sections.status(solution),
        sections.interval(solution),
        forces_needed(solution),
        sections.stage(solution, labels, fingers, number, worth=bool(worth)),
        sections.wrench_space(solution),
        sections.constraints(solution),
        sections.convergence(solution),
        sections.starts(solution),
        sections.inputs(name, solution),
        f'<script type="application/json">{text}</script></section>',
    ]
    return "\n".join(part for part in parts if part)


def _resource(name: str) -> str:
    return files("nlpgrasp.report").joinpath(name).read_text(encoding="utf-8")
