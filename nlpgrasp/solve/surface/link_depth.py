"""How deep a hand's links themselves, not the spheres that stand for them, are in the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.spheres.link_spheres import surface_points
from nlpgrasp.hands.spheres.shapes import Shape

SAMPLES = 4000  # of the body's surface


@dataclass(frozen=True)
class LinkDepth:
    """The deepest that any sample is inside the other's solid.

    Parameters
    ----------
    depth : float
        Metres, at least zero.
    link : str or None
        The link that is so deep.
    samples : int
        Points of links and body looked at.
    """

    depth: float
    link: str | None
    samples: int

    def to_dict(self) -> dict[str, float | int | str | None]:
        """Return the depth as JSON data."""
        return {"depth": self.depth, "link": self.link, "samples": self.samples}


def link_depth(body: Body, hand: URDFHand, values: dict[str, FloatArray]) -> LinkDepth:
    """Return how deep the collision shapes are in the body, from samples of both surfaces with their corners.

    Parameters
    ----------
    body : Body
    hand : URDFHand
    values : dict
        Of the hand's variables.
    """
    rng = np.random.default_rng(0)
    own = body_samples(body, rng)
    worst, link_of, samples = 0.0, None, len(own)
    for link, pose in hand.tree.body_poses(values).items():
        shapes = hand.robot.shapes.get(link, ())
        if not shapes:
            continue
        points = surface_points(shapes, rng)[0]
        samples += len(points)
        there = -float(np.min(body.signed_distance(points @ pose[:3, :3].T + pose[:3, 3])))
        local = (own - pose[:3, 3]) @ pose[:3, :3]
        depth = max(there, *(_deepest(shape, local) for shape in shapes))
        if depth > worst:
            worst, link_of = depth, link
    return LinkDepth(worst, link_of, samples)


def _deepest(shape: Shape, points: FloatArray) -> float:
    """Return how deep the deepest of points (m, 3) is inside a shape, metres; 0 where none is inside its box."""
    low, high = shape.mesh.bounds
    inside = points[np.all((points > low) & (points < high), axis=1)]
    return float(np.max(shape.depth(inside), initial=0.0)) if len(inside) else 0.0


def body_samples(body: Body, rng: np.random.Generator) -> FloatArray:
    """Return samples of the body's surface; of a mesh its vertices too."""
    if isinstance(body, Mesh):
        vertices = np.asarray(body.mesh.vertices, dtype=float)
        return np.concatenate([vertices, body.surface_samples(SAMPLES, rng)[0]])
    each = max(SAMPLES // len(body.face_names), 50)
    return np.concatenate([body.sample(name, each, rng) for name in body.face_names])
