"""Solution report: one self-contained HTML page with the content of solution files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path

from nlpgrasp.analysis.analyse import analyse, format_added
from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import at_most, capital, format_interval, format_number, format_percent, typeset
from nlpgrasp.common.types import Json
from nlpgrasp.experiments.comparison import compare
from nlpgrasp.report import solution_sections as sections
from nlpgrasp.report.grasp_scene import solution_scene
from nlpgrasp.report.html_parts import ICON, html_table, page, style, viewer
from nlpgrasp.report.key_figures import verdict
from nlpgrasp.report.solution_sections import colour_by_marginal_bound
from nlpgrasp.report.start_charts import starts
from nlpgrasp.report.task_wrenches import FingerForce, choose_wrenches, finger_forces_of
from nlpgrasp.solution.solution import GraspSolution


def complete_analyses(solution: GraspSolution) -> tuple[GraspSolution, str]:
    """Return a solution with all analyses that its problem allows, and the names of those computed, as text."""
    if solution.grasp is None:
        return solution, ""
    found = analyse(solution)
    added = format_added(solution, found)
    return found, f"Computed for this page: {added}." if added else ""


def forces_needed(solution: GraspSolution) -> str:
    """Return the required forces as text and by finger, as HTML; empty where a file does not state them."""
    needed = solution.needed
    if needed is None:
        return ""
    over = needed.is_within(solution.max_force) is False
    first, *_, last = (f"{capital(line)}." for line in solution.needed_lines())
    kind = ' class="status failed"' if over else ""
    columns = zip(needed.size, needed.normal, needed.largest, strict=True)
    rows = [[f"{i}", *(f"{format_number(force)} N" for force in forces)] for i, forces in enumerate(columns)]
    heads = ["Finger", "Force", "Normal force", "Largest force of any wrench computed"]
    drawn = html_table("Least finger forces for the hardest wrench of the task as given", heads, rows)
    return f"<h3>Forces for the task as given</h3><p>{escape(first)}</p><p{kind}>{escape(last)}</p>{drawn}"


@dataclass(frozen=True)
class GraspView:
    """Page content of one grasp.

    Parameters
    ----------
    solution : GraspSolution
        The grasp as its answer.
    scene : mapping or None
        Scene for the viewer; None if there is nothing to draw.
    labels : tuple of str
        Labels of the slider's wrenches.
    fingers : sequence of sequences of FingerForce
        Force of each finger for each wrench.
    """

    solution: GraspSolution
    scene: Json | None
    labels: tuple[str, ...]
    fingers: Sequence[Sequence[FingerForce]]

    @classmethod
    def of(cls, solution: GraspSolution) -> GraspView:
        """Return the page content of a solution's answer."""
        chosen, grasp = choose_wrenches(solution), solution.grasp
        fingers = [] if grasp is None else finger_forces_of(grasp, chosen)
        return cls(solution, solution_scene(solution, chosen), tuple(c.label for c in chosen), fingers)

    @property
    def panel(self) -> str:
        """The facts beside the scene, as HTML."""
        return sections.panel(self.solution, self.fingers[0] if self.fingers else ())

    @property
    def tables(self) -> str:
        """Finger forces, contacts and constraint values, as HTML."""
        parts = (forces_needed(self.solution), sections.contacts(self.solution), sections.constraints(self.solution))
        return f'<div class="of-grasp">{"".join(parts)}</div>'

    def numbers(self) -> Json:
        """Return labels and finger forces as JSON data."""
        return {"labels": list(self.labels), "fingers": [[asdict(f) for f in each] for each in self.fingers]}


def every(solution: GraspSolution) -> list[GraspView]:
    """Return the page content of the answer and the alternative grasps, best first."""
    return [GraspView.of(solution), *(GraspView.of(solution.with_answer(found)) for found in solution.grasps[1:])]


def scenes(shown: Sequence[GraspView]) -> list[Json]:
    """Return the scenes of several grasps, with the body in the first alone; empty if there is nothing to draw."""
    found = [each.scene for each in shown if each.scene is not None]
    first = found[:1]
    return first + [{**s, "parts": [p for p in s["parts"] if p["group"] != "body"], "alike": True} for s in found[1:]]


def replacements(shown: Sequence[GraspView]) -> list[Json]:
    """Return numbers, panel and tables of each grasp, which the page swaps in."""
    return [{**each.numbers(), "panel": each.panel, "tables": each.tables} for each in shown]


def strip(shown: Sequence[GraspView], number: int) -> str:
    """Return the small scenes as buttons; empty for one grasp, or if there is nothing to draw."""
    if len(shown) < 2 or shown[0].scene is None:
        return ""
    buttons = []
    for i, each in enumerate(shown):
        mu, robust, fragile = each.solution.mu, each.solution.robust, each.solution.is_fragile
        left = "" if robust is None else f"{format_percent(robust.share(mu))} left"
        words = typeset(f"{format_number(mu.lower)}{', ' + left if left else ''}")
        kind = ' class="fragile"' if fragile else ""
        buttons.append(
            f'<button type="button" data-grasp-number="{i}" aria-pressed="{"true" if i == 0 else "false"}"{kind}>'
            f'<canvas class="small" data-of="scene{number}" data-scene="{i}"></canvas>'
            f"<span>{escape(words)}{' (fragile)' if fragile else ''}</span></button>"
        )
    told = f"{len(shown)} distinct grasps, best first: certified quality, and what is left of it when contacts are off"
    return (
        f'<div class="strip" role="group" aria-label="Grasps kept"><p class="note">{told}</p>{"".join(buttons)}</div>'
    )


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
    every_completed = [complete_analyses(solution) for solution in solutions.values()]
    solutions = dict(zip(solutions, (solution for solution, _ in every_completed), strict=True))
    compared, notes = compare(solutions), [note for _, note in every_completed]
    title = ", ".join(s.name for s in solutions.values())
    body = []
    if len(solutions) > 1:
        body += [f"<h1>{len(solutions)} grasps compared</h1>", sections.comparison(compared, solutions)]
    heading = "h1" if len(solutions) == 1 else "h2"
    each = zip(solutions.items(), notes, strict=True)
    body += [_solution_section(name, solution, i, heading, note) for i, ((name, solution), note) in enumerate(each)]
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


def _solution_section(name: str, solution: GraspSolution, number: int, heading: str, note: str) -> str:
    """Return the section of one solution."""
    shown, coloured = every(solution), colour_by_marginal_bound(solution)
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
        f'<p class="asked">{escape(typeset(sections.problem_sentence(solution)))}</p>',
        '<div class="first">',
        sections.solution_stage(
            solution, first.labels, number, first.scene, strip(shown, number), worth=coloured is not None
        ),
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


def solution_card(solution: GraspSolution) -> str:
    """Return the small page; without a grasp it shows the body, where known, and the outcome."""
    solution = replace(solution, drawing=solution.drawn())
    shown = GraspView.of(solution)
    told, tone = verdict(solution)
    scenes = [] if shown.scene is None else [shown.scene]
    data = {"scenes": scenes, **shown.numbers()}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = [
        f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(solution.name)}</h1>'
        f'<span class="pill {tone}">{escape(told)}</span>'
        f'<span class="file">{escape(typeset(_quality_text(solution)))}</span></header>',
        sections.solution_stage(solution, shown.labels, 0, shown.scene, "", worth=False),
        f'<script type="application/json">{text}</script></section>',
    ]
    return page(solution.name, style("report.css", "card.css"), parts, ICON, viewer())


def _quality_text(solution: GraspSolution) -> str:
    """Return the certified quality and the required force as short text."""
    if solution.grasp is None:
        return "no grasp"
    quality = f"{solution.label} {' to '.join(format_interval(solution.mu.lower, solution.mu.upper))}"
    if solution.mu.lower <= 0.0 or solution.budget.absolute:
        return quality
    return f"{quality}; the task takes {at_most(1.0 / solution.mu.lower)} N at most"
