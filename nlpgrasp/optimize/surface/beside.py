"""Per-contact constraints outside the program: margin from sharp edges, and clearance of the fingertip on a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.rows import EDGE_MARGIN, ROOM, Label
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import FITS


@dataclass(frozen=True)
class AtLeast:
    """Length with a lower limit.

    Parameters
    ----------
    label : Label
    value, lower : float
        Metres.
    """

    label: Label
    value: float
    lower: float


def beside(problem: GraspProblem, placed: Placed, normals: FloatArray) -> Iterator[AtLeast]:
    """Yield the distances of contacts with inward normals (k, space) from sharp edges, and of tip centres from a mesh.

    Nothing is said of a face without sharp edges, of a fingertip that is a point or belongs to a hand with a pose, and
    of the room on bodies whose distance is an expression: rows of the program say it.
    """
    for i, value in enumerate(edge_distances(problem, placed)):
        if np.isfinite(value):
            yield AtLeast(Label(EDGE_MARGIN, fingers=(i,)), float(value), problem.margin)
    body, hand = problem.body, problem.hand
    if isinstance(body, Mesh) and hand is not None and hand.follows_contacts:
        for i, radius in enumerate(hand.tip_radii):
            if radius > 0.0:
                centre = placed.points[i] - radius * normals[i]
                yield AtLeast(Label(ROOM, fingers=(i,)), float(body.clearance(centre[None])[0]), FITS * radius)


def edge_distances(problem: GraspProblem, placed: Placed) -> FloatArray:
    """Return the distance of each contact from its face's sharp edges, (k,), metres; inf where there are none."""
    apart, faces = np.empty(len(placed.points)), np.array(placed.faces)
    for face in set(placed.faces):
        on = faces == face
        apart[on] = problem.body.edge_distance(face, placed.points[on])
    return apart


def near_edges(problem: GraspProblem, placed: Placed) -> FloatArray:
    """Return each contact's violation of the margin from sharp edges, (k,), over the body's size."""
    if problem.margin == 0.0:
        return np.zeros(len(placed.points))
    return np.asarray(np.maximum((problem.margin - edge_distances(problem, placed)) / problem.body.size, 0.0))
