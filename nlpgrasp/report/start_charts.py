"""Charts and table of a solve's starts: certified results and convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from nlpgrasp.common.formatting import capitalise, format_interval, format_number, typeset
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.report.html_parts import Curve, Mark, chart, html_table
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.start_summary import failure_reason, solver_words

STRIP_CAPTION = "Every start's certified quality; the answer has a ring."
CONVERGENCE_CAPTION = (
    "Lines: the quality while a start is improved, estimated from above on the solver's own surface. Dots: what is "
    "certified on the body itself. The answer is blue; a dot without a line is a start that was not improved further."
)
ZERO_QUALITY = 1e-8  # smaller values of mu count as zero
NO_GRASP_CAPTION = "No start ended with a certified grasp."


def start_section(solution: GraspSolution) -> str:
    """Return the charts and the table of starts as HTML; empty for a solution without starts."""
    if not solution.starts:
        return ""
    drawn_charts = [start_strip(solution), convergence_chart(solution)]
    charts = "".join(
        f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>" for svg, caption in drawn_charts if svg
    )
    sentences = (f"{capitalise(line)}." for line in solution.starts_lines())
    paragraphs = "".join(f"<p>{escape(typeset(sentence))}</p>" for sentence in sentences)
    return f'<h3>Starts</h3>{paragraphs}<div class="charts two">{charts}</div>{_start_table(solution)}'


def start_strip(solution: GraspSolution) -> tuple[str, str]:
    """Return the chart of certified quality with one dot per start with a grasp, and its caption.

    Both are empty without a grasp.
    """
    quality_by_start = {
        start.index: mu for start in solution.starts if (mu := certified_bounds(solution, start)) is not None
    }
    if not quality_by_start:
        return "", ""
    curves, marks, caption = [], [], STRIP_CAPTION
    for index, mu in quality_by_start.items():
        is_answer = mu is solution.mu
        curves.append(Curve(np.array([[mu.lower, index], [mu.upper, index]]), "best" if is_answer else "other"))
        marks.append(Mark(mu.lower, index, "answer" if is_answer else "dot"))
    if math.isfinite(solution.best_possible) and solution.best_possible <= 2.0 * solution.mu.upper:
        bound, first, last = solution.best_possible, min(quality_by_start), max(quality_by_start)
        ends = np.array([[bound, first - 0.4], [bound, last + 0.4]])
        curves.append(Curve(ends, "limit"))
        caption += " Dashed: the best possible."
    if solution.solver.get("options", {}).get("maximise_robust"):
        caption += " It was chosen by what is left when contacts are off."
    title, label = "Certified quality of every start", f"{solution.label}, certified"
    return chart(title, label, "start", curves, marks, "y"), caption


def convergence_chart(solution: GraspSolution) -> tuple[str, str]:
    """Return the chart of mu over each start's refinement rounds, and its caption.

    Lines end at certified values.
    """
    if max((max(start.history) for start in solution.starts if len(start.history) > 1), default=0.0) <= ZERO_QUALITY:
        return "", ""
    ordered_starts = sorted(solution.starts, key=lambda start: start is solution.winner)  # draws the answer on top
    curves, marks = [], []
    for start in ordered_starts:
        is_answer = start is solution.winner
        mu = certified_bounds(solution, start)
        kind = "best" if is_answer else "other" if mu is not None else "lost"
        rounds = float(len(start.history))
        if start.history:
            curves.append(Curve(_round_points(start.history), kind))
        if mu is not None:
            if start.history:
                curves.append(Curve(np.array([[rounds - 1.0, start.history[-1]], [rounds, mu.lower]]), f"{kind} last"))
            marks.append(Mark(rounds, mu.lower, "answer" if is_answer else "dot"))
    caption = CONVERGENCE_CAPTION if solution.winner is not None else NO_GRASP_CAPTION
    title = f"How the refinement raised {solution.label}, start by start"
    return chart(title, "round of the refinement", solution.label, curves, marks, "x"), caption


def certified_bounds(solution: GraspSolution, start: StartRecord) -> Bounds | None:
    """Return the certified bounds on mu of a solved start, or ``None`` for a start without a grasp.

    The start of the answer has the tighter bounds of the answer.
    """
    if start.status is not Status.SOLVED or not math.isfinite(start.mu.upper):
        return None
    return solution.mu if start is solution.winner else start.mu


def _start_table(solution: GraspSolution) -> str:
    """Return the table of starts as HTML."""
    rows = []
    for start in solution.starts:
        seconds = format_number(sum(start.seconds.values()))
        mu = certified_bounds(solution, start)
        quality = _failure_reason(solution, start) if mu is None else " to ".join(format_interval(mu.lower, mu.upper))
        answer = "answer" if start is solution.winner else ""
        rows.append(
            [
                f"{start.index}",
                answer,
                typeset(quality),
                ", ".join(start.faces),
                f"{start.iterations}",
                seconds,
                solver_words(start.message),
            ]
        )
    heads = ["Start", "", "Quality, certified", "Faces", "Iterations", "Seconds", "First solve"]
    return f"<details><summary>All {len(rows)} starts</summary>{html_table('', heads, rows)}</details>"


def _failure_reason(solution: GraspSolution, start: StartRecord) -> str:
    """Return the reason why a start has no grasp, with the mu that it reached."""
    reached = (
        f" ({solution.label} {' to '.join(format_interval(start.mu.lower, start.mu.upper))})"
        if start.mu.lower > 0.0
        else ""
    )
    return f"no grasp: {failure_reason(start)}{reached}"


def _round_points(values: Sequence[float]) -> FloatArray:
    """Return the chart points (round, value) of a sequence of values, (m, 2)."""
    return np.stack([np.arange(len(values), dtype=float), np.asarray(values)], axis=1)
