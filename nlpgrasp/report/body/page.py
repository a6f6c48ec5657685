"""HTML page of a body: 3D view, extents and names of faces."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from nlpgrasp.bodies import Body, Implicit
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.mesh.offset import MOST_OF_IT
from nlpgrasp.common.files import write_text
from nlpgrasp.common.shown.numbers import percent, rounded, vector
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.report.body.scene import scene
from nlpgrasp.report.scene.alone import ScenePage
from nlpgrasp.report.scene.axes import has_origin
from nlpgrasp.report.solution.panel import Fact

LARGE = 1.0  # metres: larger bodies are probably in millimetres
SMALL = 1e-3  # metres: smaller bodies probably have a wrong unit
LISTED = 12  # most names of faces that are listed
NOTHING = 1e-4  # share of the size: smaller coordinates are shown as 0
UNBROKEN = "\N{NO-BREAK SPACE}"
UNDER = "ng.Table.under(body)"
EXACT = 4  # digits of a suggested table height


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
    return write_text(path, _shown(body).whole(facts(body)))


def card(body: Body) -> str:
    """Return a small page that shows a body, for a notebook."""
    return _shown(body).small(_size(body))


def facts(body: Body) -> list[Fact]:
    """Return the facts about a body: extents, faces and warnings."""
    extents = np.ptp(body.bounds, axis=0)
    names = body.face_names
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    each = ", ".join(f"<code>{escape(name)}</code>" for name in names[:LISTED])
    listed = f'<p class="note">{each}{more}</p>'
    centre, of_what = vector(1e3 * body.centroid), "volume" if body.space == 3 else "area"
    about = "body.centroid; torques are about it, unless the problem has a torque_origin"
    found = [
        Fact("Size", _size(body), (_doubt(extents),), "weak" if _odd(extents) else "", broad=True),
        _bounds(body),
        Fact("Faces", str(len(names)), ("names for the faces of a contact",), more=listed),
        Fact(f"Centre of {of_what}", f"{centre} mm", (about,)),
    ]
    if isinstance(body, Mesh):
        found.append(Fact("Mesh", f"{len(body.mesh.faces)} triangles", body.repairs or ("used as it is",), broad=True))
        off = f"within {rounded(1e3 * body.offset.most, 2)} mm of the mesh over {percent(MOST_OF_IT)} of it"
        walls = f"walls: {rounded(1e3 * body.wall, 2)} mm; smoothing={body.smoothing:g}, resolution={body.resolution}"
        found.append(Fact("Smooth surface", off, ("the surface that the solver works on", walls), broad=True))
    return found


def _bounds(body: Body) -> Fact:
    """Return the body's range along each axis, and the height of a table under it as code."""
    bounds = 1e3 * body.bounds
    least = NOTHING * float(np.max(np.ptp(bounds, axis=0)))
    ends = [[rounded(v, least=least) for v in column] for column in bounds.T]
    each = [f"{axis} {low} to {high} mm" for axis, (low, high) in zip("xyz", ends, strict=False)]
    value = ", ".join(text.replace(" ", UNBROKEN) for text in each)
    low, high = (np.pad(end, (0, 3 - body.space)) for end in body.bounds)
    near = has_origin(low, high, float(np.linalg.norm(high - low)) / 2.0)
    drawn = "whose axes are drawn" if near else "whose axes are drawn at the body's corner, as its origin is far away"
    height = rounded(float(body.bounds[0, -1]), EXACT, 1e-3 * least)
    under = f'<p class="note">A table under it: <code>ng.Table({height})</code>, or <code>{UNDER}</code></p>'
    if isinstance(body, Implicit):
        under = '<p class="note">of the box that was stated, in which the body may be smaller</p>'
    more = f'<p class="note">in the body\'s frame, {drawn}</p>{under}'
    return Fact("Bounds", value, more=more, broad=True)


def _odd(extents: FloatArray) -> bool:
    return bool(np.max(extents) > LARGE or np.max(extents) < SMALL)


def _doubt(extents: FloatArray) -> str:
    if not _odd(extents):
        return "along the axes of the body's frame"
    size = "larger than a metre" if np.max(extents) > LARGE else "smaller than a millimetre"
    return f'{size}: lengths are metres; ng.Mesh.load(..., unit="mm") reads a file in millimetres'


def _name(body: Body) -> str:
    return (body.source if isinstance(body, Mesh) else None) or body.shown_name


def _shown(body: Body) -> ScenePage:
    return ScenePage(_name(body), f"The body, {_name(body)}", scene(body))


def _size(body: Body) -> str:
    """Return the extents of a body in millimetres, as text."""
    extents = vector(1e3 * np.ptp(body.bounds, axis=0)).split(", ")
    return " \N{MULTIPLICATION SIGN} ".join(extents) + " mm"
