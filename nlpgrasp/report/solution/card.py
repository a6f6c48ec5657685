"""Small page of a solution for a notebook: scene, quality and slider over task wrenches."""

from __future__ import annotations

import json
from dataclasses import replace
from html import escape

from nlpgrasp.common.shown.numbers import at_most, outwards, typeset
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.solution import sections
from nlpgrasp.report.solution.panel import verdict
from nlpgrasp.report.solution.strip import Shown
from nlpgrasp.solution.solution import GraspSolution


def card(solution: GraspSolution) -> str:
    """Return the small page; without a grasp it shows the body, where known, and the outcome."""
    solution = replace(solution, drawing=solution.drawn())
    shown = Shown.of(solution)
    told, tone = verdict(solution)
    scenes = [] if shown.scene is None else [shown.scene]
    data = {"scenes": scenes, **shown.numbers()}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = [
        f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(solution.name)}</h1>'
        f'<span class="pill {tone}">{escape(told)}</span><span class="file">{escape(typeset(_worth(solution)))}</span>'
        "</header>",
        sections.stage(solution, shown.labels, 0, shown.scene, "", worth=False),
        f'<script type="application/json">{text}</script></section>',
    ]
    return page(solution.name, style("report.css", "card.css"), parts, ICON, viewer())


def _worth(solution: GraspSolution) -> str:
    """Return the certified quality and the required force as short text."""
    if solution.grasp is None:
        return "no grasp"
    quality = f"{solution.label} {' to '.join(outwards(solution.mu.lower, solution.mu.upper))}"
    if solution.mu.lower <= 0.0 or solution.budget.absolute:
        return quality
    return f"{quality}; the task takes {at_most(1.0 / solution.mu.lower)} N at most"
