"""HTML report of solutions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from nlpgrasp.analysis.analyse import analyse, format_added
from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import (
    FORCE_UNIT,
    capitalise,
    format_interval,
    format_number,
    format_percent,
    format_upper,
    typeset,
)
from nlpgrasp.common.types import Json
from nlpgrasp.experiments.comparison import compare
from nlpgrasp.report import solution_sections as sections
from nlpgrasp.report.grasp_scene import solution_scene
from nlpgrasp.report.html_parts import Curve, Mark, chart, html_table
from nlpgrasp.report.key_figures import verdict
from nlpgrasp.report.page_builder import CARD, VIEWER, Heading, scene_page, scene_section
from nlpgrasp.report.solution_sections import colour_by_marginal_bound
from nlpgrasp.report.start_charts import start_section
from nlpgrasp.report.task_wrenches import FingerForce, choose_wrenches, finger_forces_of
from nlpgrasp.solution.solution import GraspSolution

SELF_CHECK = ("proof_checker.js", "self_check.js")  # scripts that check a page's proofs


def complete_analyses(solution: GraspSolution) -> tuple[GraspSolution, str]:
    """Return a solution with all analyses that its problem allows, and the names of the added ones as text."""
    if solution.grasp is None:
        return solution, ""
    analysed = analyse(solution)
    return analysed, format_added(solution, analysed)


def force_section(solution: GraspSolution) -> str:
    """Return the section on required finger forces as HTML; empty if the solution does not state forces."""
    forces = solution.needed
    if forces is None:
        return ""
    exceeds_limit = forces.is_within(solution.finger_limit) is False
    sentence, *_, limit_sentence = (f"{capitalise(line)}." for line in solution.needed_lines())
    kind = ' class="status failed"' if exceeds_limit else ""
    columns = zip(forces.size, forces.normal, forces.largest, strict=True)
    rows = [[f"{i}", *(f"{format_number(force)} N" for force in finger)] for i, finger in enumerate(columns)]
    heads = ["Finger", "Force", "Normal force", "Largest force of any wrench computed"]
    table = html_table("Least finger forces for the hardest wrench of the task as given", heads, rows)
    return f"<h3>Forces for the task as given</h3><p>{escape(sentence)}</p><p{kind}>{escape(limit_sentence)}</p>{table}"


def friction_section(solution: GraspSolution) -> str:
    """Return the section on the critical friction and the force at each friction as HTML; empty if unknown."""
    line, curve = solution.friction_line(), solution.force_curve()
    if not line or solution.friction is None:
        return ""
    title = f"<h3>Friction</h3><p>{escape(typeset(f'{capitalise(line)}.'))}</p>"
    if len(curve) < 2:
        return title
    points = np.array([[point.friction, point.force.upper] for point in curve])
    kinds = ["dot" if point in solution.friction.curve else "answer" for point in curve]
    marks = [Mark(at, force, kind) for (at, force), kind in zip(points.tolist(), kinds, strict=True)]
    curves = [Curve(points, "best")]
    caption = (
        "Least force at each friction, with a ring at the contacts' own: each dot is proved for larger friction too."
    )
    least = solution.friction.least.upper
    if least >= 0.5 * points[0, 0]:
        ends = points[:, 1].min(), points[:, 1].max()
        curves.append(Curve(np.array([[least, end] for end in ends]), "limit"))
        caption += " Dashed: the friction above which the task is held."
    unit = "" if solution.holding.unit != FORCE_UNIT else f", {FORCE_UNIT}"
    drawn = chart("Least force against friction", "friction", f"{solution.holding.amount}{unit}", curves, marks)
    figure = f"<figure>{drawn}<figcaption>{escape(caption)}</figcaption></figure>"
    return f'{title}<div class="charts two">{figure}</div>'


@dataclass(frozen=True)
class GraspView:
    """Content of the report's page for one grasp.

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
        """Key figures beside the scene, as HTML."""
        return sections.panel(self.solution, self.fingers[0] if self.fingers else ())

    @property
    def tables(self) -> str:
        """Finger forces, contacts and constraint values, as HTML."""
        forces = force_section(self.solution), friction_section(self.solution)
        parts = (*forces, sections.contacts(self.solution), sections.constraints(self.solution))
        return f'<div class="of-grasp">{"".join(parts)}</div>'

    def slider_data(self) -> Json:
        """Return the labels and finger forces of the task wrenches on the slider."""
        return {"labels": list(self.labels), "fingers": [[asdict(f) for f in forces] for forces in self.fingers]}


def grasp_views(solution: GraspSolution) -> list[GraspView]:
    """Return the page content of each kept grasp, best first."""
    return [GraspView.of(solution), *(GraspView.of(solution.with_answer(grasp)) for grasp in solution.grasps[1:])]


def view_scenes(views: Sequence[GraspView]) -> list[Json]:
    """Return the scenes of several grasps, with the body in the first one only."""
    scenes = [view.scene for view in views if view.scene is not None]
    return scenes[:1] + [
        {**scene, "parts": [part for part in scene["parts"] if part["group"] != "body"], "alike": True}
        for scene in scenes[1:]
    ]


def grasp_replacements(views: Sequence[GraspView]) -> list[Json]:
    """Return the content that the page swaps in for each grasp: slider data, panel and tables."""
    return [{**view.slider_data(), "panel": view.panel, "tables": view.tables} for view in views]


def grasp_strip(views: Sequence[GraspView], index: int) -> str:
    """Return the strip of small scenes to choose a grasp from, as HTML.

    The strip is empty for one grasp, or if there is nothing to draw.
    """
    if len(views) < 2 or views[0].scene is None:
        return ""
    buttons = []
    for i, view in enumerate(views):
        mu, robust, is_fragile = view.solution.mu, view.solution.robust, view.solution.is_fragile
        remaining = "" if robust is None else f", {format_percent(robust.share(mu))} left"
        text = typeset(f"{format_number(mu.lower)}{remaining}")
        kind = ' class="fragile"' if is_fragile else ""
        buttons.append(
            f'<button type="button" data-grasp-number="{i}" aria-pressed="{"true" if i == 0 else "false"}"{kind}>'
            f'<canvas class="small" data-of="scene{index}" data-scene="{i}"></canvas>'
            f"<span>{escape(text)}{' (fragile)' if is_fragile else ''}</span></button>"
        )
    note = f"{len(views)} distinct grasps, best first: certified quality, and what is left of it when contacts are off"
    return (
        f'<div class="strip" role="group" aria-label="Grasps kept"><p class="note">{note}</p>{"".join(buttons)}</div>'
    )


def write_report(solutions: Mapping[str, GraspSolution], path: str | Path) -> Path:
    """Write a page that shows solutions, after a comparison if there are several.

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
    return write_completed({name: complete_analyses(solution) for name, solution in solutions.items()}, path)


def write_completed(completed: Mapping[str, tuple[GraspSolution, str]], path: str | Path) -> Path:
    """Write the page of solutions with their analyses.

    Parameters
    ----------
    completed : mapping of str to (GraspSolution, str)
        By name, with the names of the analyses that were computed for the page, as text.
    path : str or Path

    Raises
    ------
    InputError
        Without solutions, or on a path that cannot be written.
    """
    solutions = {name: solution for name, (solution, _) in completed.items()}
    title = ", ".join(solution.name for solution in solutions.values())
    parts = []
    if len(solutions) > 1:
        table = sections.comparison(compare(solutions), solutions)
        parts += [f"<h1>{len(solutions)} grasps compared</h1>", table]
    level = "h1" if len(solutions) == 1 else "h2"
    for i, (name, (solution, added)) in enumerate(completed.items()):
        note = f"Computed for this page: {added}." if added else ""
        parts.append(_solution_section(name, solution, i, level, note))
    return write_text(path, scene_page(title, parts, scripts=(*VIEWER, *SELF_CHECK)))


def write_solution(solution: GraspSolution, path: str | Path) -> Path:
    """Write the page of one solution.

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


def _solution_section(name: str, solution: GraspSolution, index: int, level: str, note: str) -> str:
    """Return the section of one solution as HTML."""
    views, marginal_colours = grasp_views(solution), colour_by_marginal_bound(solution)
    answer = views[0]
    data = {
        "scenes": view_scenes(views),
        **answer.slider_data(),
        "grasps": grasp_replacements(views) if len(views) > 1 else [],
        "worth": marginal_colours,
    }
    strip = grasp_strip(views, index)
    parts = [
        f'<p class="asked">{escape(typeset(sections.problem_sentence(solution)))}</p>',
        sections.proof(solution),
        '<div class="first">',
        sections.solution_scene_html(
            solution, answer.labels, index, answer.scene, strip, has_marginal_colours=marginal_colours is not None
        ),
        answer.panel,
        "</div>",
        answer.tables,
        sections.wrench_space(solution),
        start_section(solution),
        sections.inputs(name, solution),
        f'<p class="note">{escape(note)}</p>' if note else "",
    ]
    heading = Heading(solution.name or name, name, verdict(solution), level)
    return scene_section(heading, [part for part in parts if part], data, index)


def solution_card(solution: GraspSolution) -> str:
    """Return the small page of a solution for a notebook.

    Without a grasp the page shows the body, if known, and the outcome.
    """
    solution = replace(solution, drawing=solution.drawn())
    view = GraspView.of(solution)
    data = {"scenes": [] if view.scene is None else [view.scene], **view.slider_data()}
    stage = sections.solution_scene_html(solution, view.labels, 0, view.scene, "", has_marginal_colours=False)
    heading = Heading(solution.name, typeset(_quality_text(solution)), verdict(solution))
    return scene_page(solution.name, [scene_section(heading, [stage], data)], [CARD])


def _quality_text(solution: GraspSolution) -> str:
    """Return the certified quality and the required force as a short text."""
    if solution.grasp is None:
        return "no grasp"
    quality = f"{solution.label} {' to '.join(format_interval(solution.mu.lower, solution.mu.upper))}"
    if solution.mu.lower <= 0.0 or solution.budget.absolute:
        return quality
    return f"{quality}; the task takes {format_upper(1.0 / solution.mu.lower)} N at most"
