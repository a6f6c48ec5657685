"""The parts of a report on one solution, as HTML."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.experiments.found.compare import Comparison
from nlpgrasp.experiments.found.result import NOT_COMPARABLE
from nlpgrasp.report.solution.worth import SCALE
from nlpgrasp.report.solution.wrench_space import shadows
from nlpgrasp.report.svg import Curve, chart
from nlpgrasp.report.table import table
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution


def comparison(compared: Comparison) -> str:
    """Return the solutions side by side, as a table."""
    rows = [
        [f"{rank}", name, str(r.mu) if r.success else "no grasp", f"{r.contacts}", "; ".join(tied), "; ".join(r.active)]
        for name, r, rank, tied in zip(compared.names, compared.records, compared.ranks, compared.ties, strict=True)
    ]
    note = "" if compared.comparable else f'<p class="status failed">{escape(NOT_COMPARABLE)}</p>'
    heads = ["Rank", "Solution", "mu certified in", "Contacts", "Ties with", "Active constraints"]
    return f"<h2>Comparison</h2>{note}" + table("Ties differ by no more than the certified gap.", heads, rows)


def status(solution: GraspSolution) -> str:
    """Return how the solve ended, in words."""
    kind = "status" if solution.success and not solution.is_fragile else "status failed"
    lines = [solution.told]
    if solution.why_not is not None:
        lines += [*solution.why_not.reasons, *solution.why_not.advice]
    if solution.robust is not None:
        lines.append(str(solution.robust))
    return "".join(f'<p class="{kind}">{escape(line)}</p>' for line in lines)


def interval(solution: GraspSolution) -> str:
    """Return the certified interval, in words and as a bar from zero."""
    if solution.grasp is None:
        return ""
    most = 1.15 * solution.mu.upper or 1.0
    left, width = 100.0 * solution.mu.lower / most, 100.0 * (solution.mu.upper - solution.mu.lower) / most
    words = f"{solution.label} is certified in {solution.mu}, a gap of {solution.mu.gap:.1%}"
    unit = f" (force budget {escape(solution.budget.kind)})"
    span = f'<span style="left:{left:.2f}%;width:{width:.2f}%"></span>'
    bar = f'<div class="bar" role="img" aria-label="{escape(words)}">{span}</div>'
    best = "" if solution.bound is None else f"<p>{escape(_sentence(solution.bound.line(solution.mu.lower)))}</p>"
    return f"<h3>Certified quality</h3><p>{escape(words)}{unit}.</p>{bar}{best}"


def stage(
    solution: GraspSolution, labels: Sequence[str], fingers: Sequence[Sequence[str]], number: int, worth: bool = False
) -> str:
    """Return the three-dimensional picture with its slider, its colours' switch if any, and its legend in words."""
    grasp = solution.grasp
    count = 0 if grasp is None else len(grasp)
    links = 0 if solution.drawing is None else len(solution.drawing.links)
    seen = f"The body with {count} contacts" + (f" and a hand of {links} links" if links else "")
    parts = ["<h3>The grasp</h3>"]
    if labels:
        parts.append(
            f'<div class="control"><label for="wrench{number}">Task wrench</label><input id="wrench{number}" '
            f'type="range" min="0" max="{len(labels) - 1}" step="1" value="0" '
            f'aria-valuetext="{escape(labels[0])}"></div>'
            f'<output for="wrench{number}" aria-live="polite">{escape("; ".join([labels[0], *fingers[0]]))}</output>'
        )
    if worth:
        parts.append(
            '<div class="control"><label><input type="checkbox" data-worth> Where a contact is worth most</label>'
            f'<span class="scale" style="background:linear-gradient(90deg,{",".join(SCALE)})"></span>'
            "<span>nothing to most, of what it adds to mu at most; grey where none may be</span></div>"
        )
    parts.append(
        f'<div class="scene" role="img" aria-label="{escape(seen)}; turn it with the mouse or a finger."></div>'
    )
    parts.append(
        "<p>Red arrows: least finger forces that produce the wrench chosen, times the certified lower bound. "
        "Blue: inward normals. Green: friction cones.</p>"
    )
    if grasp is not None:
        rows = [
            [f"{i}", face, _numbers(p), _numbers(n), type(model).__name__]
            for i, (p, n, face, model) in enumerate(
                zip(grasp.points, grasp.normals, solution.faces, grasp.contacts, strict=True)
            )
        ]
        parts.append(table("Contacts, body frame", ["Finger", "Face", "Position, m", "Inward normal", "Contact"], rows))
    return "".join(parts)


def wrench_space(solution: GraspSolution) -> str:
    """Return shadows of the wrench set and of the task."""
    charts = []
    for s in shadows(solution):
        curves = [Curve(s.grasp, "grasp", True), Curve(s.task, "task", True)]
        if s.limit is not None:
            low, high = float(np.min(s.grasp[:, 1])), float(np.max(s.grasp[:, 1]))
            curves.append(Curve(np.array([[s.limit, low], [s.limit, high]]), "limit"))
        charts.append(f"<div>{chart(f'Shadow on {s.x_label} and {s.y_label}', s.x_label, s.y_label, curves)}</div>")
    if not charts:
        return ""
    words = (
        "Shadows of what the fingers can produce with their budget (blue) and of the task times the certified lower "
        "bound (orange). In the first, in shares of what can be produced, the task comes nearest to the limit (red)."
    )
    return f'<h3>Wrench space</h3><p>{words}</p><div class="charts">{"".join(charts)}</div>'


def constraints(solution: GraspSolution) -> str:
    """Return the active constraints and what limits cost."""
    rows = [
        [c.name, f"{c.value:.5g}", f"[{c.lower:.5g}, {c.upper:.5g}]", f"{c.multiplier:.3g}"]
        for c in solution.constraints
        if c.active
    ]
    parts = []
    if rows:
        parts.append(table("Constraints at their limits", ["Constraint", "Value", "Limits", "d mu / d limit"], rows))
    if solution.prices:
        prices = [[p.name, f"{p.value:.4g}", p.unit, f"{p.gain:+.3g}"] for p in solution.prices]
        parts.append(table("What limits cost", ["Limit", "Value", "Step", "Change of mu"], prices))
    return "<h3>Constraints</h3>" + "".join(parts) if parts else ""


def convergence(solution: GraspSolution) -> str:
    """Return how each start's exchange raised mu."""
    winner, rising = solution.winner, [s for s in solution.starts if len(s.history) > 1]
    if not rising:
        return ""
    curves = [Curve(_numbered(s.history), "other") for s in rising if s is not winner]
    words = "All starts in grey: none of them is the answer."
    if winner is not None and len(winner.history) > 1:
        curves.append(Curve(_numbered(winner.history), "best"))
        words = "The best start in blue, the others in grey."
    drawn = chart("How the exchange raised mu, start by start", "round of the exchange", "mu, from above", curves)
    return f"<h3>Convergence</h3><p>{words}</p>{drawn}"


def starts(solution: GraspSolution) -> str:
    """Return a table of all starts."""
    rows = []
    for s in solution.starts:
        seconds = f"{sum(s.seconds.values()):.2f}"
        found = str(s.mu) if s.status is Status.SOLVED else s.status.name.lower().replace("_", " ")
        rows.append([f"{s.index}", found, ", ".join(s.faces), f"{s.iterations}", seconds, s.message])
    if not rows:
        return ""
    heads = ["Start", "mu certified in", "Faces", "Iterations", "Seconds", "Message"]
    return f"<h3>Starts</h3><details><summary>{len(rows)} starts</summary>{table('', heads, rows)}</details>"


def inputs(name: str, solution: GraspSolution) -> str:
    """Return all inputs and how to do it again."""
    solver = {k: v for k, v in solution.solver.items() if k != "starts"}
    data = {"problem": dict(solution.problem), "solver": solver}
    text = escape(json.dumps(data, indent=1))
    again = (
        f"nlpgrasp solve SCRIPT --starts {len(solution.starts)} --seed {solver.get('seed', 0)}\nnlpgrasp verify {name}"
    )
    return (
        f"<h3>Do it again</h3><pre>{escape(again)}</pre>"
        f"<details><summary>All inputs, options and versions</summary><pre>{text}</pre></details>"
    )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{v:.5g}" for v in values)


def _numbered(values: Sequence[float]) -> FloatArray:
    return np.stack([np.arange(len(values), dtype=float), np.asarray(values)], axis=1)
