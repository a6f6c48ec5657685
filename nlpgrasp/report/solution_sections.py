"""Sections of the solution report, as HTML."""

from __future__ import annotations

import base64
import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape

import numpy as np
import trimesh

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.formatting import capitalise, format_interval, format_number, typeset, vector
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.comparison import Comparison
from nlpgrasp.experiments.experiment_result import NOT_COMPARABLE
from nlpgrasp.global_bound.marginal_bound import MarginalBound
from nlpgrasp.problem.problem import GraspProblem, problem_from_dict
from nlpgrasp.quality.proof import prove
from nlpgrasp.report.html_parts import Curve, Html, chart, html_table
from nlpgrasp.report.key_figures import axis_end, gauge, solution_figures
from nlpgrasp.report.page_builder import figure_panel, scene_html, switches
from nlpgrasp.report.scene_parts import pack, subdivide, triangle_normals
from nlpgrasp.report.task_wrenches import FingerForce, solution_projections
from nlpgrasp.solution.analysis_records import ShadowPrice
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.solution.solution import GraspSolution

COLOUR_SCALE = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")  # cividis: even to colour-blind eyes
FORBIDDEN_COLOUR = "#b4b4b4"  # colour of forbidden parts
ENOUGH_TRIANGLES = 1500  # triangles up to which surfaces are subdivided
TONES = 100  # tones of the scale, a multiple of its steps
SMALL_BODY = 1.0  # metres: contacts of smaller bodies are shown in millimetres
# visibility switches of the scene: group, label, initially shown
SWITCHES = (
    ("hand", "Hand", True),
    ("forces", "Forces", True),
    ("normals", "Normals", False),
    ("cones", "Cones", False),
    ("through", "See through", False),
)


def colour_by_marginal_bound(solution: GraspSolution) -> Json | None:
    """Return the viewer's data of the body coloured by upper bounds on a contact's contribution to mu, or ``None``.

    Returns
    -------
    dict or None
        ``positions``: corners, packed. ``colours``: for each triangle the index of its colour in ``scale``.
    """
    coloured = marginal_colours(solution)
    if coloured is None:
        return None
    scale = sorted(set(coloured[1]))
    index = {colour: i for i, colour in enumerate(scale)}
    return {"positions": pack(coloured[0], "<f4"), "colours": [index[c] for c in coloured[1]], "scale": scale}


def marginal_colours(solution: GraspSolution) -> tuple[FloatArray, list[str]] | None:
    """Return corners (m, 3, 3) of the body's subdivided triangles, metres, and a colour for each triangle.

    For a mesh, which is in a separate file, the drawn triangles are used. None where the drawing is missing, or the
    global bound does not cover the problem.
    """
    if solution.drawing is None or solution.grasp is None or solution.bound is None:
        return None
    shape = solution.drawing.body
    try:
        problem = _problem_without_hand(solution, shape)
        marginal_bound = MarginalBound.of(problem)
    except InputError:
        return None
    corners = subdivide(shape, ENOUGH_TRIANGLES)
    area_vectors = triangle_normals(corners)
    size = np.maximum(np.linalg.norm(area_vectors, axis=1, keepdims=True), 1e-300)
    space = problem.body.space
    inward = (-area_vectors / size)[:, :space]
    on_boundary = np.linalg.norm(inward, axis=1) > 0.5  # a planar body is drawn as a plate
    bounds = np.full(len(corners), np.nan)
    lengths = np.linalg.norm(inward[on_boundary], axis=1, keepdims=True)
    bounds[on_boundary] = marginal_bound.at(corners[on_boundary].mean(axis=1)[:, :space], inward[on_boundary] / lengths)
    largest = float(np.nanmax(bounds, initial=0.0))
    if largest <= 0.0:
        return None
    return corners, [_interpolate_colour(fraction) for fraction in bounds / largest]


def _problem_without_hand(solution: GraspSolution, shape: Triangles) -> GraspProblem:
    """Return the solution's problem without its hand; a mesh body has the drawn triangles.

    Raises
    ------
    InputError
        Where the file lacks data of the problem.
    """
    data, grasp = solution.problem, solution.grasp
    mesh = Mesh(trimesh.Trimesh(shape.vertices, shape.faces)) if data["body"].get("type") == Mesh.kind else None
    return problem_from_dict(data, None if grasp is None else grasp.torque_origin, mesh)


def _interpolate_colour(fraction: float) -> str:
    """Return the colour of a fraction of the largest value, interpolated on the colour scale."""
    if np.isnan(fraction):
        return FORBIDDEN_COLOUR
    anchors = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in COLOUR_SCALE])
    position = np.rint(min(max(fraction, 0.0), 1.0) * TONES) / TONES * (len(COLOUR_SCALE) - 1)
    red, green, blue = np.rint(
        [np.interp(position, range(len(COLOUR_SCALE)), channel) for channel in anchors.T]
    ).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def comparison(compared: Comparison, solutions: Mapping[str, GraspSolution]) -> str:
    """Return the comparison table of several solutions as HTML, with small scenes and gauges on one axis."""
    axis_limit, order = max(axis_end(s) for s in solutions.values()), list(solutions)
    rows = []
    entries = zip(compared.names, compared.records, compared.ranks, compared.ties, strict=True)
    for name, record, rank, ties in entries:
        quality = " to ".join(format_interval(record.mu.lower, record.mu.upper)) if record.success else "no grasp"
        picture = Html(
            f'<canvas class="small" data-of="scene{order.index(name)}" role="img" aria-label="{escape(name)}"></canvas>'
        )
        cells = [f"{rank}", picture, name, Html(f"{escape(typeset(quality))}{gauge(solutions[name], axis_limit)}")]
        rows.append([*cells, f"{record.contacts}", "; ".join(ties), "; ".join(record.active)])
    note = "" if compared.comparable else f'<p class="status failed">{escape(NOT_COMPARABLE)}</p>'
    heads = ["Rank", "", "Solution", "Quality, certified", "Contacts", "Ties with", "Active constraints"]
    return note + html_table("Ties differ by no more than the certified gap.", heads, rows)


def problem_sentence(solution: GraspSolution) -> str:
    """Return the problem in a sentence: contacts, body, hand and task."""
    problem, hand = solution.problem, solution.problem.get("hand")
    parts = [problem["body"], *([hand] if isinstance(hand, Mapping) else [])]
    body, *hand_names = [str(part.get("source") or part["type"]).rpartition("/")[2] for part in parts]
    holder = f", held by {hand_names[0]}" if hand_names else ""
    task = solution.task_line()
    return f"{len(problem['contacts'])} contacts on {body}{holder}. {capitalise(task)}."


def panel(solution: GraspSolution, fingers: Sequence[FingerForce]) -> str:
    """Return the panel beside the scene as HTML: key figures, and finger forces for the selected wrench."""
    bars = "".join(
        f'<li class="finger"><span class="number">{i}</span><span class="bar">'
        f'<span style="width:{100 * f.share:.1f}%"></span></span><span class="words">{escape(f.words)}</span></li>'
        for i, f in enumerate(fingers)
    )
    head = "<h3>Fingers, for the task wrench shown, as given</h3>"
    forces = f'<div class="fact broad fingers">{head}<ul>{bars}</ul></div>' if bars else ""
    return figure_panel(solution_figures(solution), forces)


def solution_scene_html(
    solution: GraspSolution,
    labels: Sequence[str],
    index: int,
    scene: Json | None,
    strip: str,
    has_marginal_colours: bool,
) -> str:
    """Return the scene with switches, wrench slider and alternative grasps as HTML.

    There is only a note if there is nothing to draw.
    """
    if scene is None:
        why = "no grasp was found, or the file holds neither a drawing nor the body"
        return f'<div class="stage"><p class="note">No picture: {why}.</p></div>'
    count = 0 if solution.grasp is None else len(solution.grasp)
    links = 0 if solution.drawing is None else len(solution.drawing.links)
    description = f"The body with {count} contacts" + (f" and a hand of {links} links" if links else "")
    undrawn = escape(", ".join(scene["unseen"]))
    parts = [
        _switches(solution, has_marginal_colours) if count else "",
        _wrench_slider(labels, index) if labels else "",
        strip,
        f'<p class="note">Not drawn, since their triangles stay in a file: {undrawn}.</p>' if undrawn else "",
    ]
    return scene_html(description, parts, f"scene{index}")


def _wrench_slider(labels: Sequence[str], index: int) -> str:
    """Return the slider that selects a task wrench, as HTML."""
    return (
        f'<div class="control"><label for="wrench{index}">Task wrench, as given</label><input id="wrench{index}" '
        f'type="range" min="0" max="{len(labels) - 1}" step="1" value="0" '
        f'aria-valuetext="{escape(labels[0])}">'
        f'<output for="wrench{index}" aria-live="polite">{escape(labels[0])}</output></div>'
    )


def _switches(solution: GraspSolution, has_marginal_colours: bool) -> str:
    """Return the visibility switches of the scene as HTML."""
    has_hand = solution.problem.get("hand") is not None
    entries = [s for s in SWITCHES if s[0] != "hand" or has_hand]
    if has_marginal_colours:
        entries.append(("worth", "Where a contact is worth most", False))
    scale = (
        f'<p class="scale note" hidden><b style="background:linear-gradient(90deg,{",".join(COLOUR_SCALE)})"></b>'
        "nothing to most, of what a contact adds to mu at most; grey where none may be</p>"
    )
    return f"{switches(entries)}{scale if has_marginal_colours else ''}"


def contacts(solution: GraspSolution) -> str:
    """Return the table of contacts as HTML."""
    grasp = solution.grasp
    if grasp is None:
        return ""
    size = float(np.max(np.ptp(in_space(grasp.points), axis=0), initial=0.0))
    scale, unit, least_decimals = (1e3, "mm", 1) if size < SMALL_BODY else (1.0, "m", 3)
    rows = []
    entries = zip(grasp.points, grasp.normals, solution.faces, grasp.contacts, strict=True)
    for i, (point, normal, face, model) in enumerate(entries):
        kind = model.to_dict().get("model", type(model).__name__)
        coefficients = ", ".join(
            f"{name.replace('_', ' ')} {format_number(v)}" for name, v in model.coefficients.items()
        )
        rows.append(
            [
                f"{i} ({solution.fingers[i]})" if solution.fingers else f"{i}",
                face,
                _format_coordinates(scale * point, scale * size, least_decimals),
                typeset(vector(np.round(normal, 3))),
                f"{kind}".replace("_", " "),
                coefficients,
            ]
        )
    heads = ["Finger", "Face", f"Position, {unit}", "Inward normal", "Contact", "With"]
    origin = _format_coordinates((scale * grasp.torque_origin).tolist(), scale * size, least_decimals)
    return "<h3>Contacts</h3>" + html_table(f"In the body's frame; moments are about ({origin}) {unit}.", heads, rows)


def proof(solution: GraspSolution, largest: int = 100_000) -> str:
    """Return the answer's proof as HTML, which the page checks when it is opened, or why there is none.

    It is that of the solve, if that has at most so many bytes; else one of 1 %, and the page says so.
    """
    if solution.grasp is None:
        return ""
    try:
        known, vertices = solution.mu, solution.mu.vertices
        if vertices is not None and vertices.nbytes > largest:
            known = replace(known, vertices=None)
        data = prove(solution.grasp, solution.task, force_budget=solution.budget, known=known).to_bytes()
    except InputError as error:
        return f'<p class="asked">Nothing is proved on this page. {escape(capitalise(str(error)))}.</p>'
    line = "A proof of the quality is in this page, for its script to check."
    return (
        f'<p class="proof asked" role="status" data-measure="{escape(solution.label)}">{line}</p>'
        f'<script type="text/plain">{base64.b64encode(data).decode()}</script>'
    )


def wrench_space(solution: GraspSolution) -> str:
    """Return the charts of projections of wrench set and task, as HTML."""
    charts = []
    for projection in solution_projections(solution):
        curves = [Curve(projection.grasp, "grasp", True), Curve(projection.task, "task", True)]
        if projection.limit is not None:
            low, high = float(np.min(projection.grasp[:, 1])), float(np.max(projection.grasp[:, 1]))
            curves.append(Curve(np.array([[projection.limit, low], [projection.limit, high]]), "limit"))
        title = f"Shadow on {projection.x_label} and {projection.y_label}"
        charts.append(f"<div>{chart(title, projection.x_label, projection.y_label, curves)}</div>")
    if not charts:
        return ""
    note = (
        "Blue: the wrenches that the fingers can exert within the force budget, seen along each pair of axes. Green: "
        "the task scaled by the certified lower bound, which fits inside. First plot: the direction in which the task "
        "comes closest to the limit (red), as a share of what the fingers can exert."
    )
    return f'<h3>What the fingers can exert</h3><p class="note">{note}</p><div class="charts">{"".join(charts)}</div>'


def constraints(solution: GraspSolution) -> str:
    """Return the active constraints and the shadow prices of limits as HTML lists of sentences."""
    active = [_constraint_sentence(c, solution) for c in solution.constraints if c.active and not c.is_equation]
    prices = [_price_sentence(p, solution) for p in solution.prices]
    parts = [
        f'<h3>{title}</h3><ul class="sentences">{"".join(f"<li>{escape(typeset(s))}</li>" for s in sentences)}</ul>'
        for title, sentences in (("At their limits", active), ("What a little more would change", prices))
        if sentences
    ]
    return f'<div class="two">{"".join(f"<div>{part}</div>" for part in parts)}</div>' if parts else ""


def _constraint_sentence(report: ConstraintReport, solution: GraspSolution) -> str:
    """Return an active constraint as a sentence, with its shadow price if the solve converged."""
    lower_slack, upper_slack = report.value - report.lower, report.upper - report.value
    limit = "the least allowed" if lower_slack <= upper_slack else "the most allowed"
    gain = abs(report.multiplier) * min(abs(lower_slack), abs(upper_slack))  # by the remaining slack, to first order
    price = f"; {solution.label} changes by {format_number(report.multiplier)} a unit"
    price = price if report.multiplier and gain <= solution.mu.upper else ""
    return f"{report.name}: {format_number(report.value, 4)}, {limit}{price}."


def _price_sentence(price: ShadowPrice, solution: GraspSolution) -> str:
    """Return the effect of changing a limit by one step, as a sentence with the relative change of mu."""
    mu, label = solution.mu.lower, solution.label
    sign = "+" if price.gain > 0.0 else ""
    percent = f" ({sign}{format_number(100.0 * price.gain / mu, 2)} %)" if mu > 0.0 else ""
    return f"{price.what} (now {format_number(price.value, 4)}): {label} {sign}{format_number(price.gain)}{percent}."


def inputs(name: str, solution: GraspSolution) -> str:
    """Return all inputs, and the commands that reproduce the solution, as HTML."""
    solver = {k: v for k, v in solution.solver.items() if k != "starts"}
    data = {"problem": dict(solution.problem), "solver": solver}
    text = escape(json.dumps(data, indent=1))
    commands = "\n".join(
        [
            f"nlpgrasp solve SCRIPT --starts {len(solution.starts)} --seed {solver.get('seed', 0)}",
            f"nlpgrasp verify {shlex.quote(name)}",
        ]
    )
    return (
        f"<h3>Do it again</h3><pre>{escape(commands)}</pre>"
        f"<details><summary>All inputs, options and versions</summary><pre>{text}</pre></details>"
    )


def _format_coordinates(values: Sequence[float], size: float, least_decimals: int) -> str:
    """Return coordinates as text, with the number of decimals that shows ``size`` with three significant digits.

    There are at least ``least_decimals``.
    """
    decimals = max(least_decimals, 2 - math.floor(math.log10(size))) if size > 0.0 else least_decimals
    return typeset(", ".join(f"{round(float(v), decimals) + 0.0:.{decimals}f}" for v in values))
