"""The drawing of a grasp: made where body and hand are at hand, so that a file can be shown without them."""

from __future__ import annotations

import igl
import numpy as np
import trimesh

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.triangles import triangles
from nlpgrasp.drawing import Drawing, Triangles
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Hand
from nlpgrasp.validation import FloatArray

BODY, LINK = 2000, 80  # triangles, at most


def drawing_of(body: Body, hand: Hand | None, values: dict[str, FloatArray] | None) -> Drawing:
    """Return the body's surface and the links' collision shapes in the hand's posture."""
    links = _links(hand, values) if isinstance(hand, URDFHand) and values is not None else ()
    return Drawing(Triangles(*triangles(body, BODY)), links)


def _links(hand: URDFHand, values: dict[str, FloatArray]) -> tuple[tuple[str, Triangles], ...]:
    result = []
    for link, pose in hand.tree.body_poses(values).items():
        meshes = [shape.mesh for shape in hand.robot.shapes.get(link, ())]
        if meshes:
            joined = trimesh.util.concatenate(meshes)
            vertices, faces = _simple(np.asarray(joined.vertices, dtype=float), np.asarray(joined.faces))
            result.append((link, Triangles(vertices @ pose[:3, :3].T + pose[:3, 3], faces)))
    return tuple(result)


def _simple(vertices: FloatArray, faces: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """Return at most ``LINK`` triangles where the shape can be simplified."""
    if len(faces) > LINK:
        simple = igl.qslim(np.asfortranarray(vertices), np.asfortranarray(faces.astype(np.int32)), LINK)
        if len(simple[1]):
            return np.asarray(simple[0]), np.asarray(simple[1], dtype=np.int64)
    return vertices, faces.astype(np.int64)
