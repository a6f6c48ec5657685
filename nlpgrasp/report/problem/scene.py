"""3D scene of a problem: body, allowed faces, tables and obstacles."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.problem import GraspProblem
from nlpgrasp.problem.shown.in_words import usable_faces
from nlpgrasp.report.body import scene as of_body
from nlpgrasp.report.scene.camera import framed
from nlpgrasp.report.scene.surfaces import surface
from nlpgrasp.report.scene.surroundings import WIDE, around, slab


def scene(problem: GraspProblem) -> Json:
    """Return the viewer's scene of a problem; metres, body frame: the body's scene with its surroundings."""
    shape = of_body.drawn_shape(problem.body)
    drawn, usable = of_body.scene(problem.body, shape), usable_faces(problem)
    size, flat = drawn["size"], drawn["flat"]
    vertices, found = shape.vertices, around(problem.constraints)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    shapes = [("obstacle", name, obstacle) for name, obstacle in found.obstacles]
    seen = framed(np.concatenate([vertices, *(obstacle.vertices for _, _, obstacle in shapes)]), middle, size)
    if flat:
        shapes += [("table", "table", slab(height, vertices, size)) for height in found.heights]
    tables = [{"at": [*middle[:2].tolist(), h], "half": WIDE * size} for h in found.heights]
    return {
        **drawn,
        "parts": [*drawn["parts"], *({"group": g, "name": n, **surface(s).to_dict()} for g, n, s in shapes)],
        "tables": [] if flat else tables,
        "unseen": list(found.unseen),
        "contacts": [label for label in drawn["contacts"] if label["label"] in usable],
        "frame": [*drawn["frame"], *np.round(seen, of_body.DIGITS).tolist()],
    }
