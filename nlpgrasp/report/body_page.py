"""HTML pages of a body or a problem: 3D scene and key figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from nlpgrasp.bodies import Body, Implicit
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.mesh.signed_distance import OFFSET_QUANTILE
from nlpgrasp.common.drawing import CONE, NORMAL, Drawing, Triangles, drawing_size
from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import format_number, format_percent, typeset, vector
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem import GraspProblem
from nlpgrasp.problem.description import describe_problem, task_range, usable_faces
from nlpgrasp.report.page_builder import (
    CARD,
    Heading,
    KeyFigure,
    figure_panel,
    scene_html,
    scene_page,
    scene_section,
    switches,
)
from nlpgrasp.report.scene_parts import (
    OBLIQUE_VIEW,
    TABLE_HALF_WIDTH,
    TOP_VIEW,
    body_axes,
    has_origin,
    outermost_points,
    slab,
    subdivide,
    surface,
    surroundings_of,
    triangle_normals,
)

MOST = 6000  # most triangles
FACE_TRIANGLES = 2000  # triangles for locating the middle of a face
MOST_LABELS = 24  # most labelled faces
DOT = 0.02  # radius of the mark under a label, as a share of the body's size
DIGITS = 7  # decimals of coordinates for display, metres
# visibility switches of the scene: group, label, initially shown
SWITCHES = (("triad", "Axes", True), ("through", "See through", False))
LARGE = 1.0  # metres: larger bodies are probably in millimetres
SMALL = 1e-3  # metres: smaller bodies probably have a wrong unit
MOST_LISTED = 12  # most names of faces that are listed
ZERO_SHARE = 1e-4  # share of the size: smaller coordinates are shown as 0
UNBROKEN = "\N{NO-BREAK SPACE}"
TABLE_UNDER = "ng.Table.under(body)"
TABLE_DIGITS = 4  # digits of a suggested table height


def body_triangles(body: Body) -> Triangles:
    """Return the triangles with which a body is drawn."""
    return Triangles(*triangles(body, MOST))


def body_scene(body: Body, shape: Triangles | None = None) -> Json:
    """Return the viewer's scene of a body, in metres and the body frame.

    The format is that of ``report.grasp_scene.solution_scene``.

    The names of the faces are under ``contacts``; ``axes`` are those of the frame. ``shape`` is
    ``body_triangles(body)``, if already computed.
    """
    shape = body_triangles(body) if shape is None else shape
    size = drawing_size(Drawing(shape), None)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    axes = body_axes(low, high, size, body.space)
    outline = [outermost_points(shape.vertices, (low + high) / 2.0, size), [axes["at"]], axes["ends"]]
    flat = body.space == 2
    return {
        "size": size,
        "flat": flat,
        "parts": [{"group": "body", "name": "body", **surface(shape).to_dict()}],
        "tables": [],
        "unseen": [],
        "contacts": _face_labels(body, shape),
        "palm": None,
        "arrows": [],
        "lengths": {"normal": NORMAL * size, "cone": CONE * size, "disc": DOT * size, "shaft": DOT * size, "pad": 0.0},
        "axes": axes,
        "frame": np.round(np.concatenate(outline), DIGITS).tolist(),
        "view": list(TOP_VIEW if flat else OBLIQUE_VIEW),
    }


def _face_labels(body: Body, shape: Triangles) -> list[Json]:
    """Return one label for each face of a body, near the face's middle.

    A body of one face, or of very many, has no labels.
    """
    if not 1 < len(body.faces) <= MOST_LABELS:
        return []
    corners = subdivide(shape, FACE_TRIANGLES)
    centres, area_vectors = corners.mean(axis=1), triangle_normals(corners)
    areas = np.linalg.norm(area_vectors, axis=1)
    distances = np.stack([_face_distance(body, name, centres) for name in body.face_names])
    owner = np.argmin(distances, axis=0)
    if body.space == 2:  # the plate's upper and lower sides are not faces of the body
        owner[np.abs(area_vectors[:, 2]) > 0.5 * np.maximum(areas, 1e-300)] = -1
    labels = []
    for i, name in enumerate(body.face_names):
        triangles_of_face = np.flatnonzero((owner == i) & (areas > 0.0))
        if len(triangles_of_face):
            mean = np.average(centres[triangles_of_face], axis=0, weights=areas[triangles_of_face])
            middle = triangles_of_face[np.argmin(np.linalg.norm(centres[triangles_of_face] - mean, axis=1))]
            labels.append(_face_label(name, centres[middle], -area_vectors[middle] / areas[middle]))
    return labels


def _face_distance(body: Body, name: str, points: FloatArray) -> FloatArray:
    """Return approximate distances (m,) of points (m, 3) from a face, metres."""
    h, slope, _, extent = body.evaluate(name, points[:, : body.space])
    return np.asarray(np.abs(h) / np.maximum(slope, 1e-12) + np.maximum(extent, 0.0))


def _face_label(name: str, point: FloatArray, inward: FloatArray) -> Json:
    """Return the scene data of a face's label."""
    position, normal = np.round(point, DIGITS).tolist(), np.round(inward, DIGITS).tolist()
    return {"at": position, "inward": normal, "tip": 0.0, "slope": None, "face": f"face {name}", "label": name}


@dataclass(frozen=True)
class ScenePage:
    """HTML page that shows one 3D scene.

    Parameters
    ----------
    name : str
        Name of the page.
    description : str
        Content of the scene, for screen readers.
    scene : dict
        Data of the viewer.
    """

    name: str
    description: str
    scene: Json

    def full_page(self, figures: Sequence[KeyFigure], note: str = "") -> str:
        """Return the page with the scene and key figures beside it.

        ``note`` is shown beside the title.
        """
        return self._page([f'<div class="first">{self._stage()}{figure_panel(figures)}</div>'], note)

    def card(self, note: str) -> str:
        """Return a small page for a notebook with the scene alone."""
        return self._page([self._stage()], note, CARD)

    def _page(self, parts: Sequence[str], note: str, *sheets: str) -> str:
        section = scene_section(Heading(self.name, typeset(note)), parts, {"scenes": [self.scene]})
        return scene_page(self.name, [section], sheets)

    def _stage(self) -> str:
        """Return the scene with visibility switches as HTML, and below it the names of parts that are not drawn."""
        undrawn = ", ".join(self.scene["unseen"])
        note = f'<p class="note">not drawn: {escape(undrawn)}</p>' if undrawn else ""
        return scene_html(self.description, [switches(SWITCHES), note])


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
    return write_text(path, _body_page(body).full_page(body_figures(body)))


def body_card(body: Body) -> str:
    """Return a small page that shows a body, for a notebook."""
    return _body_page(body).card(_format_extents(body))


def body_figures(body: Body) -> list[KeyFigure]:
    """Return the key figures of a body: size, bounds, faces, centre and mesh."""
    extents = np.ptp(body.bounds, axis=0)
    names = body.face_names
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    listed_names = ", ".join(f"<code>{escape(name)}</code>" for name in names[:MOST_LISTED])
    name_list = f'<p class="note">{listed_names}{more}</p>'
    centre, of_what = vector(1e3 * body.centroid), "volume" if body.space == 3 else "area"
    note = "body.centroid; torques are about it, unless the problem has a torque_origin"
    figures = [
        KeyFigure(
            "Size",
            _format_extents(body),
            (_size_warning(extents),),
            "weak" if _is_implausible(extents) else "",
            broad=True,
        ),
        _bounds_figure(body),
        KeyFigure("Faces", str(len(names)), ("names for the faces of a contact",), more=name_list),
        KeyFigure(f"Centre of {of_what}", f"{centre} mm", (note,)),
    ]
    if isinstance(body, Mesh):
        figures.append(
            KeyFigure("Mesh", f"{len(body.mesh.faces)} triangles", body.repairs or ("used as it is",), broad=True)
        )
        percent = format_percent(OFFSET_QUANTILE)
        offset = f"within {format_number(1e3 * body.offset.most, 2)} mm of the mesh over {percent} of it"
        walls = (
            f"walls: {format_number(1e3 * body.wall, 2)} mm; smoothing={body.smoothing:g}, resolution={body.resolution}"
        )
        figures.append(KeyFigure("Smooth surface", offset, ("the surface that the solver works on", walls), broad=True))
    return figures


def _bounds_figure(body: Body) -> KeyFigure:
    """Return the key figure of a body's bounds, with the Python code that creates a table under the body."""
    bounds = 1e3 * body.bounds
    zero_size = ZERO_SHARE * float(np.max(np.ptp(bounds, axis=0)))
    ends = [[format_number(v, least=zero_size) for v in column] for column in bounds.T]
    ranges = [f"{axis} {low} to {high} mm" for axis, (low, high) in zip("xyz", ends, strict=False)]
    value = ", ".join(text.replace(" ", UNBROKEN) for text in ranges)
    low, high = (np.pad(end, (0, 3 - body.space)) for end in body.bounds)
    is_origin_drawn = has_origin(low, high, float(np.linalg.norm(high - low)) / 2.0)
    axes_note = (
        "whose axes are drawn"
        if is_origin_drawn
        else "whose axes are drawn at the body's corner, as its origin is far away"
    )
    height = format_number(float(body.bounds[0, -1]), TABLE_DIGITS, 1e-3 * zero_size)
    table_note = f'<p class="note">A table under it: <code>ng.Table({height})</code>, or <code>{TABLE_UNDER}</code></p>'
    if isinstance(body, Implicit):
        table_note = '<p class="note">of the box that was stated, in which the body may be smaller</p>'
    more = f'<p class="note">in the body\'s frame, {axes_note}</p>{table_note}'
    return KeyFigure("Bounds", value, more=more, broad=True)


def _is_implausible(extents: FloatArray) -> bool:
    """Return whether the extents of a body are so large or small that the unit of length is probably wrong."""
    return bool(np.max(extents) > LARGE or np.max(extents) < SMALL)


def _size_warning(extents: FloatArray) -> str:
    """Return the note beside a body's size: a warning if the size is implausible."""
    if not _is_implausible(extents):
        return "along the axes of the body's frame"
    size = "larger than a metre" if np.max(extents) > LARGE else "smaller than a millimetre"
    return f'{size}: lengths are metres; ng.Mesh.load(..., unit="mm") reads a file in millimetres'


def _body_name(body: Body) -> str:
    """Return the name of a body's file, or else its title."""
    return (body.source if isinstance(body, Mesh) else None) or body.shown_name


def _body_page(body: Body) -> ScenePage:
    """Return the page of a body."""
    return ScenePage(_body_name(body), f"The body, {_body_name(body)}", body_scene(body))


def _format_extents(body: Body) -> str:
    """Return the extents of a body in millimetres, as text."""
    extents = vector(1e3 * np.ptp(body.bounds, axis=0)).split(", ")
    return " \N{MULTIPLICATION SIGN} ".join(extents) + " mm"


def problem_scene(problem: GraspProblem) -> Json:
    """Return the viewer's scene of a problem: body, tables and obstacles, in metres and the body frame."""
    shape = body_triangles(problem.body)
    bare_scene, usable = body_scene(problem.body, shape), usable_faces(problem)
    size, flat = bare_scene["size"], bare_scene["flat"]
    vertices, surroundings = shape.vertices, surroundings_of(problem.constraints)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    shapes = [("obstacle", name, obstacle) for name, obstacle in surroundings.obstacles]
    outline = outermost_points(
        np.concatenate([vertices, *(obstacle.vertices for _, _, obstacle in shapes)]), middle, size
    )
    if flat:
        shapes += [("table", "table", slab(height, vertices, size)) for height in surroundings.heights]
    tables = [{"at": [*middle[:2].tolist(), h], "half": TABLE_HALF_WIDTH * size} for h in surroundings.heights]
    return {
        **bare_scene,
        "parts": [*bare_scene["parts"], *({"group": g, "name": n, **surface(s).to_dict()} for g, n, s in shapes)],
        "tables": [] if flat else tables,
        "unseen": list(surroundings.unseen),
        "contacts": [label for label in bare_scene["contacts"] if label["label"] in usable],
        "frame": [*bare_scene["frame"], *np.round(outline, DIGITS).tolist()],
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
    return write_text(path, _problem_page(problem).full_page(problem_figures(problem), "what is asked"))


def problem_card(problem: GraspProblem) -> str:
    """Return a small page that shows a problem, for a notebook."""
    return _problem_page(problem).card(f"exert {task_range(problem)}")


def problem_figures(problem: GraspProblem) -> list[KeyFigure]:
    """Return the parts of a problem as key figures."""
    return [
        KeyFigure(p.title, p.value, more="".join(map(_note_html, p.notes)), broad=True)
        for p in describe_problem(problem)
    ]


def _note_html(note: str) -> str:
    """Return a note as HTML with all characters unchanged.

    Notes quote names and code, whose minus signs are to be copied.
    """
    return f'<p class="note">{escape(note)}</p>'


def _problem_page(problem: GraspProblem) -> ScenePage:
    """Return the page of a problem."""
    return ScenePage(problem.name, f"The problem {problem.name}", problem_scene(problem))
