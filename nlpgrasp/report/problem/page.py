"""The page of a problem: the body in its surroundings, and what is asked in words, before anything is solved."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.common.shown.numbers import typeset
from nlpgrasp.problem import GraspProblem
from nlpgrasp.problem.shown.in_words import in_words, task_words
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.problem.scene import scene
from nlpgrasp.report.scene.switches import switches
from nlpgrasp.report.solution.panel import Fact

SWITCHES = (("triad", "Axes", True), ("through", "See through", False))


def write_problem(problem: GraspProblem, path: str | Path) -> Path:
    """Write a page that shows a problem; it opens from disk and needs no network.

    Parameters
    ----------
    problem : GraspProblem
    path : str or Path

    Raises
    ------
    InputError
        On a path that cannot be written.
    """
    panel = f'<aside class="panel">{"".join(fact.html() for fact in facts(problem))}</aside>'
    stage, data = _stage(problem)
    parts = [_opening(problem), f'<div class="first"><div class="stage">{stage}</div>{panel}</div>', data]
    return write_text(path, page(problem.name, style("report.css"), parts, ICON, viewer()))


def card(problem: GraspProblem) -> str:
    """Return a small page that shows a problem, for a notebook's frame."""
    stage, data = _stage(problem)
    parts = [_opening(problem, f"exert {task_words(problem)}"), f'<div class="stage">{stage}</div>', data]
    return page(problem.name, style("report.css", "card.css"), parts, ICON, viewer())


def facts(problem: GraspProblem) -> list[Fact]:
    """Return what is asked, part by part."""
    return [Fact(p.title, p.value, more="".join(map(_as_written, p.notes)), broad=True) for p in in_words(problem)]


def _as_written(note: str) -> str:
    """Return a remark as HTML with its signs as they are: it quotes names and code."""
    return f'<p class="note">{escape(note)}</p>'


def _opening(problem: GraspProblem, beside: str = "what is asked") -> str:
    return (
        f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(problem.name)}</h1>'
        f'<span class="file">{escape(typeset(beside))}</span></header>'
    )


def _stage(problem: GraspProblem) -> tuple[str, str]:
    """Return the scene's place on the page with its switches, and its data."""
    aria = f"The problem {problem.name}; turn it with the mouse, a finger or the arrow keys."
    drawn = scene(problem)
    unseen = f'<p class="note">not drawn: {escape(", ".join(drawn["unseen"]))}</p>' if drawn["unseen"] else ""
    text = json.dumps({"scenes": [drawn]}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    place = f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>{switches(SWITCHES)}{unseen}'
    return place, f'<script type="application/json">{text}</script></section>'
