"""Distances of a hand's links from the body, tables and obstacles, as constraints that a file states.

The distance of a link is found by alternating projections between its shapes and the body's surface (Cheney and
Goldstein 1959, Proc. Amer. Math. Soc. 10, 448-450), from the samples of the link that are nearest to the body. Each
pair of points bounds it from above, so that a distance that is stated truly is not refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.scalar_constraints import CLEARANCE
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.solution.obstructions import TABLE
from nlpgrasp.verify.convex_solids import Distance, solids_around, vectorised_distance
from nlpgrasp.verify.link_checks import SLACK, link_samples
from nlpgrasp.verify.link_shapes import LinkShape
from nlpgrasp.verify.numeric_urdf_hand import require_links
from nlpgrasp.verify.stated_placement import ConstraintValue, NumericBody, NumericHand, StatedPlacement, require_body
from nlpgrasp.verify.surface_geometry import SMALLEST

TABLE_ROWS = "table"  # name of a table's constraints
FARTHEST = 0.05  # metres: larger distances of links are stated as this one
STARTS = 20  # samples of a link from which its distance is searched
PROJECTIONS, LEAST_GAIN = 100, 1e-7  # most projections onto the link; metres that one has to gain
FOOT_STEPS, DIFFERENCE = 4, 1e-6  # Newton steps onto the body's surface; metres of finite differences


def clearance_constraints(
    hand: NumericHand, surface: NumericBody | None, constraints: Sequence[Json], placement: StatedPlacement
) -> Iterator[ConstraintValue]:
    """Yield the constraints on the distance of links with shapes from all that a clearance above 0 is required from.

    From the body they are those of links that are not rigidly connected to a fingertip's link.
    """
    linked_hand, body = require_links(hand, "links"), require_body(surface)
    tip_roots = {linked_hand.rigid_root(str(tip["link"])) for tip in linked_hand.tips}
    clearance = number("problem.hand.clearance", linked_hand.data["clearance"], at_least=0.0)
    solids = [
        (TABLE_ROWS if solid.name == TABLE else solid.name, solid.clearance, solid.distance, SLACK + solid.rough)
        for solid in solids_around(constraints, placement)
    ]
    for kind, least, distance, slack in [(CLEARANCE, clearance, vectorised_distance(body), SLACK), *solids]:
        for link, shapes in linked_hand.shapes.items() if least > 0.0 else ():
            if kind != CLEARANCE or linked_hand.rigid_root(link) not in tip_roots:
                value, name = link_distance(shapes, linked_hand.poses[link], distance), f"{kind}, {link}"
                yield ConstraintValue(name, value, least, scale=placement.size, stated_below=True, measurement=slack)


def link_distance(shapes: Sequence[LinkShape], pose: FloatArray, distance: Distance) -> float:
    """Return the distance of a link's shapes from a body, metres, at most ``FARTHEST``; negative if they overlap.

    Parameters
    ----------
    shapes : sequence of LinkShape
    pose : (4, 4) array
        The link's frame in the body's.
    distance : callable
        Points (m, 3), body frame, to signed distances (m,) from the body, metres: exactly zero on its surface.
    """
    points = link_samples(shapes, np.random.default_rng(2)) @ pose[:3, :3].T + pose[:3, 3]
    distances = distance(points)
    least = float(np.min(distances))
    if least <= 0.0 or least > 2.0 * FARTHEST:
        return min(least, FARTHEST)
    trees = [SearchTree(shape.vertices, shape.faces) for shape in shapes]
    points, least = points[np.argsort(distances, kind="stable")[:STARTS]], np.inf
    for _ in range(PROJECTIONS):
        feet = _feet(points, distance)
        squared, nearest = _nearest_points(trees, (feet - pose[:3, 3]) @ pose[:3, :3])
        gap = float(np.min(np.sqrt(squared) + np.abs(distance(feet))))
        if gap > least - LEAST_GAIN:
            break
        points, least = nearest @ pose[:3, :3].T + pose[:3, 3], gap
    return min(least, gap, FARTHEST)


def _feet(points: FloatArray, distance: Distance) -> FloatArray:
    """Return points (m, 3) of a body's surface below points (m, 3) outside, by Newton's method along the gradient."""
    steps = DIFFERENCE * np.concatenate([np.eye(3), -np.eye(3)])
    for _ in range(FOOT_STEPS):
        ahead, behind = distance((points + steps[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
        gradients = (ahead - behind).T / (2.0 * DIFFERENCE)
        squared = np.maximum(np.sum(gradients**2, axis=1), SMALLEST)
        points = points - (distance(points) / squared)[:, None] * gradients
    return points


def _nearest_points(trees: Sequence[SearchTree], points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return squared distances (m,) and nearest points (m, 3) of the shapes' surfaces to points (m, 3)."""
    squared, _, nearest = (np.stack(values) for values in zip(*(tree.nearest(points) for tree in trees), strict=True))
    first = np.argmin(squared, axis=0)
    return squared[first, range(len(points))], nearest[first, range(len(points))]
