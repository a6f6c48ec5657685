"""Surface colours by marginal bound: upper bound on a contact's contribution to mu at each triangle."""

from __future__ import annotations

import numpy as np
import trimesh

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.worth import ContactWorth
from nlpgrasp.problem.from_dict import problem_from_dict
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.report.scene.surfaces import cut, packed
from nlpgrasp.solution.solution import GraspSolution

SCALE = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")  # cividis: even to colour-blind eyes
EXCLUDED = "#b4b4b4"  # colour of forbidden parts
ENOUGH = 1500  # triangles up to which surfaces are subdivided
TONES = 100  # tones of the scale, a multiple of its steps


def worth(solution: GraspSolution) -> Json | None:
    """Return the body's triangles coloured by upper bounds on a contact's contribution to mu, or None.

    Returns
    -------
    dict or None
        ``positions``: corners, packed. ``colours``: for each triangle the index of its colour in ``scale``.
    """
    found = coloured(solution)
    if found is None:
        return None
    scale = sorted(set(found[1]))
    place = {colour: i for i, colour in enumerate(scale)}
    return {"positions": packed(found[0], "<f4"), "colours": [place[c] for c in found[1]], "scale": scale}


def coloured(solution: GraspSolution) -> tuple[FloatArray, list[str]] | None:
    """Return corners (m, 3, 3) of the body's subdivided triangles, metres, and a colour for each.

    For a mesh, which is in a separate file, the drawn triangles are used. None where the drawing is missing, or the
    global bound does not cover the problem.
    """
    if solution.drawing is None or solution.grasp is None or solution.bound is None:
        return None
    shape = solution.drawing.body
    try:
        problem = _problem(solution, shape)
        measured = ContactWorth.of(problem)
    except InputError:
        return None
    corners = cut(shape, ENOUGH)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    space = problem.body.space
    inward = (-across / size)[:, :space]
    rim = np.linalg.norm(inward, axis=1) > 0.5  # a planar body is drawn as a plate: contacts are on its boundary
    shares = np.full(len(corners), np.nan)
    length = np.linalg.norm(inward[rim], axis=1, keepdims=True)
    shares[rim] = measured.at(corners[rim].mean(axis=1)[:, :space], inward[rim] / length)
    most = float(np.nanmax(shares, initial=0.0))
    if most <= 0.0:
        return None
    return corners, [_colour(share) for share in shares / most]


def _problem(solution: GraspSolution, shape: Triangles) -> GraspProblem:
    """Return the problem without its hand, as far as the file contains it, with a mesh as drawn.

    Raises
    ------
    InputError
        Where the file lacks data of the problem.
    """
    data, grasp = solution.problem, solution.grasp
    drawn = Mesh(trimesh.Trimesh(shape.vertices, shape.faces)) if data["body"].get("type") == Mesh.kind else None
    return problem_from_dict(data, None if grasp is None else grasp.torque_origin, drawn)


def _colour(share: float) -> str:
    """Return the interpolated colour of a share of the largest value."""
    if np.isnan(share):
        return EXCLUDED
    anchors = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in SCALE])
    at = np.rint(min(max(share, 0.0), 1.0) * TONES) / TONES * (len(SCALE) - 1)
    red, green, blue = np.rint([np.interp(at, range(len(SCALE)), channel) for channel in anchors.T]).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"
