"""Penetration depths of a hand's links in each other, from their collision shapes.

Links that are rigidly connected or neighbours in the chain are left out, as are those that overlap by construction: in
nine tenths of random postures. The depth of two convex shapes is the shortest translation that separates them. Of other
shapes it is the largest sum of depths, in both, of points on the surface of either.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.obstructions import LEAST_DEPTH, LinkPenetration, link_name
from nlpgrasp.verify.convex_solids import penetration_depth
from nlpgrasp.verify.link_shapes import LinkShape
from nlpgrasp.verify.numeric_urdf_hand import NumericLinkedHand

RANDOM_POSTURES, MOST_FREE = 20, 2  # random postures, and most of them in which links that overlap by construction part
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])  # of separating planes
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


class NumericSelfPenetration:
    """Penetration depths of a hand's links in each other, for any posture.

    Parameters
    ----------
    hand : NumericLinkedHand
    samples : mapping of str to (m, 3) array
        Points of the surface of each link with shapes, metres, link frame.
    """

    def __init__(self, hand: NumericLinkedHand, samples: Mapping[str, FloatArray]) -> None:
        self._hand, self._samples = hand, samples
        self._parts = {link: [_Part(shape) for shape in shapes] for link, shapes in hand.shapes.items()}
        self._ball_centres = {link: (points.min(axis=0) + points.max(axis=0)) / 2.0 for link, points in samples.items()}
        self._ball_radii = {
            link: float(np.max(np.linalg.norm(points - self._ball_centres[link], axis=1)))
            for link, points in samples.items()
        }
        self._pairs = list(_separate_links(hand))
        self._rng, self._random = np.random.default_rng(1), list[dict[str, float]]()
        self._permanent: dict[tuple[str, str], bool] = {}  # whether a pair overlaps by construction, once it is known
        self._last: tuple[Mapping[str, float], LinkPenetration] | None = None  # an approach does not change the joints

    def in_posture(self, hand: NumericLinkedHand, tolerance: float) -> LinkPenetration:
        """Return the deepest penetration of one link in another, in a posture."""
        joints = hand.posture["joint_positions"]
        if self._last is None or self._last[0] != joints:
            deepest = LinkPenetration(tolerance=tolerance)
            for pair in self._pairs:
                depth = self._depth(hand, pair)
                if depth > max(deepest.depth, LEAST_DEPTH) and not self._is_permanent(pair):
                    deepest = LinkPenetration(depth, pair[0], link_name(pair[1]), tolerance)
            self._last = joints, deepest
        return self._last[1]

    def _depth(self, hand: NumericLinkedHand, pair: tuple[str, str]) -> float:
        """Return the penetration depth of two links in each other, metres."""
        if self._permanent.get(pair, False):
            return 0.0
        first, second = (hand.poses[link] for link in pair)
        relative = np.linalg.inv(second) @ first
        between = relative[:3, :3] @ self._ball_centres[pair[0]] + relative[:3, 3] - self._ball_centres[pair[1]]
        if np.linalg.norm(between) > self._ball_radii[pair[0]] + self._ball_radii[pair[1]]:
            return 0.0
        samples = [self._samples[pair[0]] @ relative[:3, :3].T + relative[:3, 3], self._samples[pair[1]]]
        if _are_apart(*samples):
            return 0.0
        depths = [0.0]
        for a, b in product(*(self._parts[link] for link in pair)):
            depths.append(a.depth_in(b, relative, np.concatenate(samples)))
        return max(depths)

    def _is_permanent(self, pair: tuple[str, str]) -> bool:
        """Return whether two links overlap by construction: in nearly all of several random postures."""
        if pair not in self._permanent:
            free_count = 0
            for i in range(RANDOM_POSTURES):
                if i == len(self._random):
                    self._random.append(self._hand.random_positions(self._rng))
                posture = self._hand.with_posture({"joint_positions": self._random[i]})
                free_count += self._depth(posture, pair) <= LEAST_DEPTH
                if free_count > MOST_FREE:
                    break
            self._permanent[pair] = free_count <= MOST_FREE
        return self._permanent[pair]


@dataclass(frozen=True)
class _Part:
    """Collision shape of a link with its search tree."""

    shape: LinkShape

    @cached_property
    def tree(self) -> SearchTree:
        """Search tree of the shape's triangles."""
        return SearchTree(self.shape.vertices, self.shape.faces)

    def depth_in(self, other: _Part, relative: FloatArray, samples: FloatArray) -> float:
        """Return the penetration depth of the shape in another one, metres.

        Parameters
        ----------
        other : _Part
        relative : (4, 4) array
            Pose of this shape's link in the other's.
        samples : (m, 3) array
            Points of both links' surfaces, in the other link's frame.
        """
        corners = self.shape.corners
        vertices = (self.shape.vertices if corners is None else corners) @ relative[:3, :3].T + relative[:3, 3]
        other_vertices = other.shape.vertices if other.shape.corners is None else other.shape.corners
        if _are_apart(vertices, other_vertices):
            return 0.0
        if corners is not None and other.shape.corners is not None:
            return penetration_depth(vertices, other_vertices)
        low, high = (
            getattr(np, bound)([f(v, axis=0) for v in (vertices, other_vertices)], axis=0)
            for bound, f in (("max", np.min), ("min", np.max))
        )
        shared = samples[np.all((samples >= low - LEAST_DEPTH) & (samples <= high + LEAST_DEPTH), axis=1)]
        if not len(shared):
            return 0.0
        distances = self.tree.exact_signed_distance((shared - relative[:3, 3]) @ relative[:3, :3])
        other_distances = other.tree.exact_signed_distance(shared)
        inside = np.maximum(distances, other_distances) <= LEAST_DEPTH
        return max(0.0, float(np.max(-(distances + other_distances)[inside], initial=0.0)))


def _separate_links(hand: NumericLinkedHand) -> Iterator[tuple[str, str]]:
    """Yield the pairs of links that both have shapes and are separated by more than one moving joint."""
    neighbours = {
        frozenset(map(hand.rigid_root, pair))
        for pair in (
            *((link.parent, link.name) for link in hand.links if link.moves),
            *(loop.links for loop in hand.linkages.loops),
        )
    }
    for a, b in combinations(hand.shapes, 2):
        roots = frozenset((hand.rigid_root(a), hand.rigid_root(b)))
        if len(roots) == 2 and roots not in neighbours:
            yield a, b


def _are_apart(first: FloatArray, second: FloatArray) -> bool:
    """Return whether a plane across one of several directions separates two sets of points, (m, 3) and (n, 3)."""
    between = second.mean(axis=0) - first.mean(axis=0)
    directions = np.concatenate([between[None], DIRECTIONS])
    return bool(np.any(np.max(first @ directions.T, axis=0) < np.min(second @ directions.T, axis=0)))
