"""Charts and table of a solve's starts: certified results and convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from nlpgrasp.common.formatting import capital, format_interval, format_number, typeset
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.report.html_parts import Curve, Mark, chart, html_table
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.start_summary import failure_reason, solver_words

STRIP = "Every start's certified quality; the answer has a ring."
RISING = (
    "Lines: the quality while a start is improved, estimated from above on the solver's own surface. Dots: what is "
    "certified on the body itself. The answer is blue; a dot without a line is a start that was not improved further."
)
NOTHING = 1e-8  # smaller values of mu count as zero
NONE = "No start ended with a certified grasp."


def starts(solution: GraspSolution) -> str:
    """Return both charts and the table; empty for a solution without starts."""
    if not solution.starts:
        return ""
    drawn = [strip(solution), convergence(solution)]
    charts = "".join(f"<figure>{svg}<figcaption>{escape(text)}</figcaption></figure>" for svg, text in drawn if svg)
    sentences = (f"{capital(line)}." for line in solution.starts_lines())
    told = "".join(f"<p>{escape(typeset(sentence))}</p>" for sentence in sentences)
    return f'<h3>Starts</h3>{told}<div class="charts two">{charts}</div>{_start_table(solution)}'


def strip(solution: GraspSolution) -> tuple[str, str]:
    """Return a chart with one dot for each start with a grasp, and its caption; empty without any."""
    found = {s.index: mu for s in solution.starts if (mu := certified(solution, s)) is not None}
    if not found:
        return "", ""
    curves, marks, caption = [], [], STRIP
    for index, mu in found.items():
        is_answer = mu is solution.mu
        curves.append(Curve(np.array([[mu.lower, index], [mu.upper, index]]), "best" if is_answer else "other"))
        marks.append(Mark(mu.lower, index, "answer" if is_answer else "dot"))
    if math.isfinite(solution.best_possible) and solution.best_possible <= 2.0 * solution.mu.upper:
        ends = np.array([[solution.best_possible, min(found) - 0.4], [solution.best_possible, max(found) + 0.4]])
        curves.append(Curve(ends, "limit"))
        caption += " Dashed: the best possible."
    if solution.solver.get("options", {}).get("maximise_robust"):
        caption += " It was chosen by what is left when contacts are off."
    title, label = "Certified quality of every start", f"{solution.label}, certified"
    return chart(title, label, "start", curves, marks, "y"), caption


def convergence(solution: GraspSolution) -> tuple[str, str]:
    """Return the chart of mu over each start's refinement, and a caption; lines end at certified values."""
    if max((max(s.history) for s in solution.starts if len(s.history) > 1), default=0.0) <= NOTHING:
        return "", ""
    ordered = sorted(solution.starts, key=lambda s: s is solution.winner)  # draws the answer on top
    curves, marks = [], []
    for s in ordered:
        is_answer = s is solution.winner
        mu = certified(solution, s)
        kind = "best" if is_answer else "other" if mu is not None else "lost"
        end = float(len(s.history))
        if s.history:
            curves.append(Curve(_as_array(s.history), kind))
        if mu is not None:
            if s.history:
                curves.append(Curve(np.array([[end - 1.0, s.history[-1]], [end, mu.lower]]), f"{kind} last"))
            marks.append(Mark(end, mu.lower, "answer" if is_answer else "dot"))
    text = RISING if solution.winner is not None else NONE
    title = f"How the exchange raised {solution.label}, start by start"
    return chart(title, "round of the exchange", solution.label, curves, marks, "x"), text


def certified(solution: GraspSolution, start: StartRecord) -> Bounds | None:
    """Return the certified bounds of a start's grasp; for the answer its own, tighter ones; None without a grasp."""
    if start.status is not Status.SOLVED or not math.isfinite(start.mu.upper):
        return None
    return solution.mu if start is solution.winner else start.mu


def _start_table(solution: GraspSolution) -> str:
    rows = []
    for s in solution.starts:
        seconds = format_number(sum(s.seconds.values()))
        mu = certified(solution, s)
        found = _failure_reason(solution, s) if mu is None else " to ".join(format_interval(mu.lower, mu.upper))
        mark = "answer" if s is solution.winner else ""
        rows.append(
            [
                f"{s.index}",
                mark,
                typeset(found),
                ", ".join(s.faces),
                f"{s.iterations}",
                seconds,
                solver_words(s.message),
            ]
        )
    heads = ["Start", "", "Quality, certified", "Faces", "Iterations", "Seconds", "First solve"]
    return f"<details><summary>All {len(rows)} starts</summary>{html_table('', heads, rows)}</details>"


def _failure_reason(solution: GraspSolution, start: StartRecord) -> str:
    """Return the reason why a start has no grasp, with the mu that it reached."""
    has = (
        f" ({solution.label} {' to '.join(format_interval(start.mu.lower, start.mu.upper))})"
        if start.mu.lower > 0.0
        else ""
    )
    return f"no grasp: {failure_reason(start)}{has}"


def _as_array(values: Sequence[float]) -> FloatArray:
    return np.stack([np.arange(len(values), dtype=float), np.asarray(values)], axis=1)
