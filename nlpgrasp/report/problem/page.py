"""HTML page of a problem before any solve: body and surroundings, with the task and constraints as text."""

from __future__ import annotations

from html import escape
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.problem import GraspProblem
from nlpgrasp.problem.shown.in_words import in_words, task_range
from nlpgrasp.report.problem.scene import scene
from nlpgrasp.report.scene.alone import ScenePage
from nlpgrasp.report.solution.panel import Fact


def write_problem(problem: GraspProblem, path: str | Path) -> Path:
    """Write a self-contained HTML page that shows a problem.

    Parameters
    ----------
    problem : GraspProblem
    path : str or Path

    Raises
    ------
    InputError
        On a path that cannot be written.
    """
    return write_text(path, _shown(problem).whole(facts(problem), "what is asked"))


def card(problem: GraspProblem) -> str:
    """Return a small page that shows a problem, for a notebook."""
    return _shown(problem).small(f"exert {task_range(problem)}")


def facts(problem: GraspProblem) -> list[Fact]:
    """Return the parts of the problem as facts."""
    return [Fact(p.title, p.value, more="".join(map(_as_written, p.notes)), broad=True) for p in in_words(problem)]


def _as_written(note: str) -> str:
    """Return a note as HTML with its signs unchanged: it quotes names and code."""
    return f'<p class="note">{escape(note)}</p>'


def _shown(problem: GraspProblem) -> ScenePage:
    return ScenePage(problem.name, f"The problem {problem.name}", scene(problem))
