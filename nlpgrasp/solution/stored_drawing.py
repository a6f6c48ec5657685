"""Triangle meshes of body and hand stored in a solution file for display."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.mesh.display_triangles import simplify, triangles
from nlpgrasp.common.drawing import Drawing, Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Hand, PosedHand, Values
from nlpgrasp.problem.problem import GraspProblem

BODY, LINK = 2000, 320  # largest numbers of triangles


def draw_body_and_hand(body: Body, hand: Hand | None, values: Values) -> Drawing:
    """Return the triangles of the body's surface and of the links' collision shapes in a posture."""
    links = _draw_links(hand, values) if isinstance(hand, URDFHand) else ()
    return Drawing(Triangles(*triangles(body, BODY)), links)


def draw_problem(problem: GraspProblem, hand_data: Json | None) -> Drawing:
    """Return the drawing of a problem's body, and of its hand in the posture of a solution."""
    if hand_data is None or not isinstance(problem.hand, PosedHand):
        return draw_body_and_hand(problem.body, None, {})
    return draw_body_and_hand(problem.body, problem.hand, problem.hand.values_of(hand_data))


def _draw_links(hand: URDFHand, values: Values) -> tuple[tuple[str, Triangles], ...]:
    """Return the collision shapes of each link in a posture, simplified, by link name."""
    import trimesh

    result = []
    for link, pose in hand.tree.body_poses(values).items():
        meshes = [shape.mesh for shape in hand.robot.shapes.get(link, ())]
        if meshes:
            joined = trimesh.util.concatenate(meshes)
            vertices, faces = simplify(np.asarray(joined.vertices, dtype=float), np.asarray(joined.faces), LINK)
            result.append((link, Triangles(vertices @ pose[:3, :3].T + pose[:3, 3], faces)))
    return tuple(result)
