"""The starts of a solve: where each ended as certified, how the exchange raised it, and all about them in a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from nlpgrasp.common.shown.numbers import outwards, rounded, typeset
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.report.svg import Curve, Mark, chart
from nlpgrasp.report.table import table
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

STRIP = "Every start's certified quality; the answer has a ring."
RISING = (
    "The exchange works on the solver's own surface and comes down to mu from above: a line may begin too high, and "
    "the dots are what is certified on the body itself. The answer's line is blue."
)
NOTHING = 1e-8  # values of mu that are zero but for rounding
NONE = "No start ended with a certified grasp."


def starts(solution: GraspSolution) -> str:
    """Return both charts and the table; nothing of a solution without starts."""
    if not solution.starts:
        return ""
    drawn = [strip(solution), convergence(solution)]
    charts = "".join(f"<figure>{svg}<figcaption>{escape(text)}</figcaption></figure>" for svg, text in drawn if svg)
    return f'<h3>Starts</h3><div class="charts two">{charts}</div>{_table(solution)}'


def strip(solution: GraspSolution) -> tuple[str, str]:
    """Return a chart with one dot for each start that found a grasp, and its caption; empty where none did."""
    found = [s for s in solution.starts if _certified(s)]
    if not found:
        return "", ""
    curves, marks = [], []
    for s in found:
        is_answer = s is solution.winner
        low, high = _interval(solution, s)
        curves.append(Curve(np.array([[low, s.index], [high, s.index]]), "best" if is_answer else "other"))
        marks.append(Mark(low, s.index, "answer" if is_answer else "dot"))
    if math.isfinite(solution.best_possible) and solution.best_possible <= 2.0 * solution.mu.upper:
        last = float(max(s.index for s in found))
        ends = np.array(
            [[solution.best_possible, min(s.index for s in found) - 0.4], [solution.best_possible, last + 0.4]]
        )
        curves.append(Curve(ends, "limit"))
        caption = f"{STRIP} Dashed: the best possible."
    else:
        caption = STRIP
    return chart(
        "Certified quality of every start", f"{solution.label}, certified", "start", curves, marks, "y"
    ), caption


def convergence(solution: GraspSolution) -> tuple[str, str]:
    """Return how each start's exchange raised mu, and a caption: lines that end at what is certified of the start."""
    rising = [s for s in solution.starts if len(s.history) > 1]
    if max((max(s.history) for s in rising), default=0.0) <= NOTHING:
        return "", ""
    ordered = sorted(rising, key=lambda s: s is solution.winner)  # the answer on top
    curves, marks = [], []
    for s in ordered:
        is_answer = s is solution.winner
        kind = "best" if is_answer else "other" if _certified(s) else "lost"
        curves.append(Curve(_numbered(s.history), kind))
        if _certified(s):
            end = len(s.history)
            value = _interval(solution, s)[0]
            curves.append(Curve(np.array([[end - 1.0, s.history[-1]], [end, value]]), f"{kind} last"))
            marks.append(Mark(float(end), value, "answer" if is_answer else "dot"))
    text = RISING if solution.winner is not None else NONE
    return chart("How the exchange raised mu, start by start", "round of the exchange", "mu", curves, marks, "x"), text


def _certified(start: StartRecord) -> bool:
    return start.status is Status.SOLVED and math.isfinite(start.mu.upper)


def _interval(solution: GraspSolution, start: StartRecord) -> tuple[float, float]:
    """Return what is certified of a start; of the answer's what its own, closer certificate says."""
    mu = solution.mu if start is solution.winner else start.mu
    return mu.lower, mu.upper


def _table(solution: GraspSolution) -> str:
    rows = []
    for s in solution.starts:
        seconds = rounded(sum(s.seconds.values()))
        found = (
            " to ".join(outwards(s.mu.lower, s.mu.upper)) if _certified(s) else s.status.name.lower().replace("_", " ")
        )
        mark = "answer" if s is solution.winner else ""
        rows.append([f"{s.index}", mark, typeset(found), ", ".join(s.faces), f"{s.iterations}", seconds, s.message])
    heads = ["Start", "", "Quality, certified", "Faces", "Iterations", "Seconds", "Message"]
    return f"<details><summary>All {len(rows)} starts</summary>{table('', heads, rows)}</details>"


def _numbered(values: Sequence[float]) -> FloatArray:
    return np.stack([np.arange(len(values), dtype=float), np.asarray(values)], axis=1)
