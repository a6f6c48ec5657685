"""HTML pages of a body or a problem: one scene with facts beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from nlpgrasp.bodies import Body, Implicit
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.mesh.signed_distance import MOST_OF_IT
from nlpgrasp.common.drawing import CONE, NORMAL, Drawing, Triangles, drawing_size
from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import format_number, format_percent, typeset, vector
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem import GraspProblem
from nlpgrasp.problem.description import describe_problem, task_range, usable_faces
from nlpgrasp.report.html_parts import ICON, page, style, viewer
from nlpgrasp.report.key_figures import KeyFigure
from nlpgrasp.report.scene_parts import (
    FROM_ABOVE,
    FROM_ASIDE,
    WIDE,
    around,
    body_axes,
    has_origin,
    outermost_points,
    slab,
    subdivide,
    surface,
    switches,
)

MOST = 6000  # most triangles
ENOUGH = 2000  # triangles for locating the middle of a face
NAMED = 24  # most labelled faces
DOT = 0.02  # radius of the mark under a label, as a share of the body's size
DIGITS = 7  # decimals of coordinates for display, metres
# visibility switches of the scene: group, label, initially shown
SWITCHES = (("triad", "Axes", True), ("through", "See through", False))
LARGE = 1.0  # metres: larger bodies are probably in millimetres
SMALL = 1e-3  # metres: smaller bodies probably have a wrong unit
LISTED = 12  # most names of faces that are listed
NOTHING = 1e-4  # share of the size: smaller coordinates are shown as 0
UNBROKEN = "\N{NO-BREAK SPACE}"
UNDER = "ng.Table.under(body)"
EXACT = 4  # digits of a suggested table height


def body_triangles(body: Body) -> Triangles:
    """Return the triangles that are drawn for a body."""
    return Triangles(*triangles(body, MOST))


def body_scene(body: Body, shape: Triangles | None = None) -> Json:
    """Return the viewer's scene of a body; metres, body frame, in the format of ``report.grasp_scene.scene``.

    The names of the faces are under ``contacts``; ``axes`` are those of the frame. ``shape`` is
    ``body_triangles(body)``, if already computed.
    """
    shape = body_triangles(body) if shape is None else shape
    size = drawing_size(Drawing(shape), None)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    axes = body_axes(low, high, size, body.space)
    seen = [outermost_points(shape.vertices, (low + high) / 2.0, size), [axes["at"]], axes["ends"]]
    flat = body.space == 2
    return {
        "size": size,
        "flat": flat,
        "parts": [{"group": "body", "name": "body", **surface(shape).to_dict()}],
        "tables": [],
        "unseen": [],
        "contacts": _labels(body, shape),
        "palm": None,
        "arrows": [],
        "lengths": {"normal": NORMAL * size, "cone": CONE * size, "disc": DOT * size, "shaft": DOT * size, "pad": 0.0},
        "axes": axes,
        "frame": np.round(np.concatenate(seen), DIGITS).tolist(),
        "view": list(FROM_ABOVE if flat else FROM_ASIDE),
    }


def _labels(body: Body, shape: Triangles) -> list[Json]:
    """Return the labels of a body with several faces, each on its face near the middle."""
    if not 1 < len(body.faces) <= NAMED:
        return []
    corners = subdivide(shape, ENOUGH)
    centres, across = corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    near = np.stack([_face_distance(body, name, centres) for name in body.face_names])
    owner = np.argmin(near, axis=0)
    if body.space == 2:  # the plate's upper and lower sides are not faces of the body
        owner[np.abs(across[:, 2]) > 0.5 * np.maximum(areas, 1e-300)] = -1
    found = []
    for i, name in enumerate(body.face_names):
        own = np.flatnonzero((owner == i) & (areas > 0.0))
        if len(own):
            mean = np.average(centres[own], axis=0, weights=areas[own])
            at = own[np.argmin(np.linalg.norm(centres[own] - mean, axis=1))]
            found.append(_face_label(name, centres[at], -across[at] / areas[at]))
    return found


def _face_distance(body: Body, name: str, points: FloatArray) -> FloatArray:
    """Return approximate distances of points (m, 3) from a face, (m,), metres, from surface and extents."""
    h, slope, _, extent = body.evaluate(name, points[:, : body.space])
    return np.asarray(np.abs(h) / np.maximum(slope, 1e-12) + np.maximum(extent, 0.0))


def _face_label(name: str, at: FloatArray, inward: FloatArray) -> Json:
    place, normal = np.round(at, DIGITS).tolist(), np.round(inward, DIGITS).tolist()
    return {"at": place, "inward": normal, "tip": 0.0, "slope": None, "face": f"face {name}", "label": name}


@dataclass(frozen=True)
class ScenePage:
    """Page of one named scene.

    Parameters
    ----------
    name : str
        Name of the page.
    told : str
        Description of the scene, for screen readers.
    scene : dict
        Data of the viewer.
    """

    name: str
    told: str
    scene: Json

    def whole(self, facts: Sequence[KeyFigure], beside: str = "") -> str:
        """Return the full page, the scene beside facts; ``beside`` is appended to its head."""
        panel = f'<aside class="panel">{"".join(fact.html() for fact in facts)}</aside>'
        first = f'<div class="first"><div class="stage">{self._stage()}</div>{panel}</div>'
        return page(self.name, style("report.css"), [self._opening(beside), first, self._data()], ICON, viewer())

    def small(self, beside: str) -> str:
        """Return a small page for a notebook: the scene alone."""
        parts = [self._opening(beside), f'<div class="stage">{self._stage()}</div>', self._data()]
        return page(self.name, style("report.css", "card.css"), parts, ICON, viewer())

    def _opening(self, beside: str) -> str:
        return (
            f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(self.name)}</h1>'
            f'<span class="file">{escape(typeset(beside))}</span></header>'
        )

    def _stage(self) -> str:
        """Return the scene with its switches, and the names of parts that are not drawn."""
        aria = f"{self.told}; turn it with the mouse, a finger or the arrow keys."
        unseen = ", ".join(self.scene["unseen"])
        note = f'<p class="note">not drawn: {escape(unseen)}</p>' if unseen else ""
        place = f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>'
        return f"{place}{switches(SWITCHES)}{note}"

    def _data(self) -> str:
        text = json.dumps({"scenes": [self.scene]}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        return f'<script type="application/json">{text}</script></section>'


def write_body(body: Body, path: str | Path) -> Path:
    """Write a self-contained HTML page that shows a body.

    Parameters
    ----------
    body : Body
    path : str or Path

    Raises
    ------
    InputError
        On a path that cannot be written.
    """
    return write_text(path, _body_page(body).whole(body_facts(body)))


def body_card(body: Body) -> str:
    """Return a small page that shows a body, for a notebook."""
    return _body_page(body).small(_format_extents(body))


def body_facts(body: Body) -> list[KeyFigure]:
    """Return the facts about a body: extents, faces and warnings."""
    extents = np.ptp(body.bounds, axis=0)
    names = body.face_names
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    each = ", ".join(f"<code>{escape(name)}</code>" for name in names[:LISTED])
    listed = f'<p class="note">{each}{more}</p>'
    centre, of_what = vector(1e3 * body.centroid), "volume" if body.space == 3 else "area"
    about = "body.centroid; torques are about it, unless the problem has a torque_origin"
    found = [
        KeyFigure(
            "Size",
            _format_extents(body),
            (_size_warning(extents),),
            "weak" if _is_implausible(extents) else "",
            broad=True,
        ),
        _bounds(body),
        KeyFigure("Faces", str(len(names)), ("names for the faces of a contact",), more=listed),
        KeyFigure(f"Centre of {of_what}", f"{centre} mm", (about,)),
    ]
    if isinstance(body, Mesh):
        found.append(
            KeyFigure("Mesh", f"{len(body.mesh.faces)} triangles", body.repairs or ("used as it is",), broad=True)
        )
        off = (
            f"within {format_number(1e3 * body.offset.most, 2)} mm of the mesh over {format_percent(MOST_OF_IT)} of it"
        )
        walls = (
            f"walls: {format_number(1e3 * body.wall, 2)} mm; smoothing={body.smoothing:g}, resolution={body.resolution}"
        )
        found.append(KeyFigure("Smooth surface", off, ("the surface that the solver works on", walls), broad=True))
    return found


def _bounds(body: Body) -> KeyFigure:
    """Return the body's range along each axis, and the height of a table under it as code."""
    bounds = 1e3 * body.bounds
    least = NOTHING * float(np.max(np.ptp(bounds, axis=0)))
    ends = [[format_number(v, least=least) for v in column] for column in bounds.T]
    each = [f"{axis} {low} to {high} mm" for axis, (low, high) in zip("xyz", ends, strict=False)]
    value = ", ".join(text.replace(" ", UNBROKEN) for text in each)
    low, high = (np.pad(end, (0, 3 - body.space)) for end in body.bounds)
    near = has_origin(low, high, float(np.linalg.norm(high - low)) / 2.0)
    drawn = "whose axes are drawn" if near else "whose axes are drawn at the body's corner, as its origin is far away"
    height = format_number(float(body.bounds[0, -1]), EXACT, 1e-3 * least)
    under = f'<p class="note">A table under it: <code>ng.Table({height})</code>, or <code>{UNDER}</code></p>'
    if isinstance(body, Implicit):
        under = '<p class="note">of the box that was stated, in which the body may be smaller</p>'
    more = f'<p class="note">in the body\'s frame, {drawn}</p>{under}'
    return KeyFigure("Bounds", value, more=more, broad=True)


def _is_implausible(extents: FloatArray) -> bool:
    return bool(np.max(extents) > LARGE or np.max(extents) < SMALL)


def _size_warning(extents: FloatArray) -> str:
    if not _is_implausible(extents):
        return "along the axes of the body's frame"
    size = "larger than a metre" if np.max(extents) > LARGE else "smaller than a millimetre"
    return f'{size}: lengths are metres; ng.Mesh.load(..., unit="mm") reads a file in millimetres'


def _body_name(body: Body) -> str:
    return (body.source if isinstance(body, Mesh) else None) or body.shown_name


def _body_page(body: Body) -> ScenePage:
    return ScenePage(_body_name(body), f"The body, {_body_name(body)}", body_scene(body))


def _format_extents(body: Body) -> str:
    """Return the extents of a body in millimetres, as text."""
    extents = vector(1e3 * np.ptp(body.bounds, axis=0)).split(", ")
    return " \N{MULTIPLICATION SIGN} ".join(extents) + " mm"


def problem_scene(problem: GraspProblem) -> Json:
    """Return the viewer's scene of a problem; metres, body frame: the body's scene with its surroundings."""
    shape = body_triangles(problem.body)
    drawn, usable = body_scene(problem.body, shape), usable_faces(problem)
    size, flat = drawn["size"], drawn["flat"]
    vertices, found = shape.vertices, around(problem.constraints)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    shapes = [("obstacle", name, obstacle) for name, obstacle in found.obstacles]
    seen = outermost_points(np.concatenate([vertices, *(obstacle.vertices for _, _, obstacle in shapes)]), middle, size)
    if flat:
        shapes += [("table", "table", slab(height, vertices, size)) for height in found.heights]
    tables = [{"at": [*middle[:2].tolist(), h], "half": WIDE * size} for h in found.heights]
    return {
        **drawn,
        "parts": [*drawn["parts"], *({"group": g, "name": n, **surface(s).to_dict()} for g, n, s in shapes)],
        "tables": [] if flat else tables,
        "unseen": list(found.unseen),
        "contacts": [label for label in drawn["contacts"] if label["label"] in usable],
        "frame": [*drawn["frame"], *np.round(seen, DIGITS).tolist()],
    }


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
    return write_text(path, _problem_page(problem).whole(problem_facts(problem), "what is asked"))


def problem_card(problem: GraspProblem) -> str:
    """Return a small page that shows a problem, for a notebook."""
    return _problem_page(problem).small(f"exert {task_range(problem)}")


def problem_facts(problem: GraspProblem) -> list[KeyFigure]:
    """Return the parts of the problem as facts."""
    return [
        KeyFigure(p.title, p.value, more="".join(map(_verbatim_html, p.notes)), broad=True)
        for p in describe_problem(problem)
    ]


def _verbatim_html(note: str) -> str:
    """Return a note as HTML with its signs unchanged: it quotes names and code."""
    return f'<p class="note">{escape(note)}</p>'


def _problem_page(problem: GraspProblem) -> ScenePage:
    return ScenePage(problem.name, f"The problem {problem.name}", problem_scene(problem))
