"""The grasp in three dimensions, as traces for plotly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from nlpgrasp.common.shown.drawing import COLOURS, CONE, FORCE, NORMAL, Triangles, drawn_size
from nlpgrasp.common.spatial import in_space, tangents
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.report.solution.chosen_wrenches import ChosenWrench
from nlpgrasp.solution.solution import GraspSolution

ROUND = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
HEAD = (0.09, 0.035)  # length and radius of an arrow's head, of the body's size
STEEPEST = 1.5  # slope up to which a friction cone is drawn whole


Trace: TypeAlias = dict[str, object]
"""One object of a plotly scene."""

Coordinates: TypeAlias = dict[str, list[float | None]]
"""Points as plotly wants them: lists ``x``, ``y``, ``z``."""


def scene(solution: GraspSolution, chosen: list[ChosenWrench]) -> tuple[list[Trace], list[list[Coordinates]]]:
    """Return plotly traces, arrows last, and for each chosen wrench the arrows' coordinates.

    Returns
    -------
    traces : list of dict
        The last two are the arrows' shafts (a line) and heads (a mesh).
    arrows : list of [shafts, heads]
    """
    grasp, drawing = solution.grasp, solution.drawing
    traces: list[Trace] = []
    if drawing is not None:
        traces.append(_surface(drawing.body, "body", COLOURS["body"], 0.55))
        traces += [_surface(shape, name, COLOURS["link"], 0.8) for name, shape in drawing.links]
    if grasp is None:
        return traces, []
    points, size = in_space(grasp.points), drawn_size(drawing, grasp.points)
    traces += [_contacts(grasp, solution.faces), _normals(grasp, size), *_cones(grasp, size)]
    largest = max((float(np.max(np.linalg.norm(c.forces, axis=1))) for c in chosen), default=1.0) or 1.0
    arrows = [_arrows(points, in_space(c.forces) * (FORCE * size / largest), size) for c in chosen]
    if arrows:
        traces += _finger_forces(*arrows[0], len(points))
    return traces, [list(a) for a in arrows]


def _contacts(grasp: Grasp, faces: Sequence[str]) -> Trace:
    """Return the contacts as numbered points."""
    return {
        "type": "scatter3d",
        "name": "contacts",
        "mode": "markers+text",
        **_xyz(in_space(grasp.points)),
        "text": [str(i) for i in range(len(grasp))],
        "textposition": "top center",
        "hovertext": [f"finger {i} on {face}" for i, face in enumerate(faces)],
        "hoverinfo": "text",
        "marker": {"size": 5, "color": "#111"},
    }


def _normals(grasp: Grasp, size: float) -> Trace:
    """Return the inward normals as lines."""
    points, normals = in_space(grasp.points), in_space(grasp.normals)
    return {
        "type": "scatter3d",
        "name": "inward normals",
        "mode": "lines",
        **_xyz(_segments(points, points + NORMAL * size * normals)),
        "hoverinfo": "skip",
        "line": {"width": 5, "color": COLOURS["normal"]},
    }


def _finger_forces(shafts: Coordinates, heads: Coordinates, count: int) -> list[Trace]:
    """Return the arrows of the first wrench: their shafts, and their heads as cones of triangles."""
    n = len(ROUND)
    ring = [[o + n, o + k, o + (k + 1) % n] for o in range(0, count * (n + 1), n + 1) for k in range(n)]
    i, j, k = np.array(ring).T.tolist()
    line = {"width": 8, "color": COLOURS["force"]}
    head = {"i": i, "j": j, "k": k, "color": COLOURS["force"], "hoverinfo": "skip", "flatshading": True}
    return [
        {"type": "scatter3d", "name": "finger forces", "mode": "lines", **shafts, "line": line, "hoverinfo": "skip"},
        {"type": "mesh3d", "name": "arrow heads", **heads, **head},
    ]


def _surface(shape: Triangles, name: str, colour: str, opacity: float) -> Trace:
    i, j, k = shape.faces.T.tolist()
    return {
        "type": "mesh3d",
        "name": name,
        **_xyz(shape.vertices),
        "i": i,
        "j": j,
        "k": k,
        "color": colour,
        "opacity": opacity,
        "hoverinfo": "name",
        "flatshading": True,
    }


def _cones(grasp: Grasp, size: float) -> list[Trace]:
    """Return the friction cones, opening away from the body: where arrows that press come from."""
    points, normals = in_space(grasp.points), in_space(grasp.normals)
    xyz: list[FloatArray] = []
    corners: list[list[int]] = []
    for p, n, model in zip(points, normals, grasp.contacts, strict=True):
        friction = model.coefficients.get("friction")
        if friction is None:
            continue
        height = CONE * size / max(1.0, friction / STEEPEST)
        first, second = _plane(n, grasp.space)
        ring = p - height * n + height * friction * (np.cos(ROUND)[:, None] * first + np.sin(ROUND)[:, None] * second)
        start = sum(len(x) for x in xyz)
        corners += [[start + len(ROUND), start + a, start + (a + 1) % len(ROUND)] for a in range(len(ROUND))]
        xyz.append(np.vstack([ring, p]))
    if not xyz:
        return []
    i, j, k = np.array(corners).T.tolist()
    look = {"color": COLOURS["cone"], "opacity": 0.35, "hoverinfo": "skip"}
    return [{"type": "mesh3d", "name": "friction cones", **_xyz(np.vstack(xyz)), "i": i, "j": j, "k": k, **look}]


def _plane(normal: FloatArray, space: int) -> tuple[FloatArray, FloatArray]:
    """Return two directions that a cone spreads in: a planar grasp's stays in its plane."""
    first, second = tangents(normal[None, :])[0]
    if space == 2:
        return np.array([-normal[1], normal[0], 0.0]), np.zeros(3)
    return first, second


def _arrows(points: FloatArray, forces: FloatArray, size: float) -> tuple[Coordinates, Coordinates]:
    """Return shafts and heads of arrows that end at the contacts."""
    lengths = np.linalg.norm(forces, axis=1, keepdims=True)
    along = np.divide(forces, lengths, out=np.zeros_like(forces), where=lengths > 1e-9 * size)
    heads = np.minimum(HEAD[0] * size, lengths)
    tails = points - forces
    necks = points - heads * along
    corners = []
    for p, neck, a, head in zip(points, necks, along, heads[:, 0], strict=True):
        first, second = tangents(a[None, :])[0] if np.any(a) else np.zeros((2, 3))
        radius = HEAD[1] * size * head / (HEAD[0] * size)
        corners.append(neck + radius * (np.cos(ROUND)[:, None] * first + np.sin(ROUND)[:, None] * second))
        corners.append(p[None, :])
    return _xyz(_segments(tails, necks)), _xyz(np.vstack(corners))


def _segments(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return lines as one path, broken by rows of NaN."""
    gap = np.full_like(start, np.nan)
    return np.stack([start, end, gap], axis=1).reshape(-1, 3)


def _xyz(points: FloatArray) -> Coordinates:
    """Return coordinates as plotly wants them; NaN as null, rounded to five digits of the largest."""
    largest = float(np.nanmax(np.abs(points), initial=1e-12))
    rounded = np.round(points, 5 - int(np.floor(np.log10(largest))))
    return {
        a: [None if np.isnan(v) else v for v in column.tolist()] for a, column in zip("xyz", rounded.T, strict=True)
    }
