"""Fingertip distances and misalignment in a batch of postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.tips import Tip
from nlpgrasp.hands.urdf.link_tree import LinkTree

SIDES = 9  # sides of the triangulation of a patch that is not round
ASKEW = np.cos(np.radians(30.0))  # cosine of the largest angle at which patches count as facing each other
CLOSE = 2e-3  # metres: the direction between nearer points is not used
AT_ONCE = 2_000_000  # pairs of points in a batch


@dataclass(frozen=True)
class _Placed:
    """Sample points of a patch, its ball radius, and outward normals unless it is round.

    Arrays are (m, 3) in the link's frame, (b, m, 3) in the palm's in b postures.
    """

    points: FloatArray
    radius: float
    normals: FloatArray | None


def _samples(tip: Tip) -> _Placed:
    """Return the samples of a patch in its link's frame."""
    if tip.standoff > 0.0:
        return _Placed(tip.backbone, tip.standoff, None)
    shape = tip.surface(SIDES)
    corners = shape.vertices[shape.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(shape.vertices)
    for k in range(3):
        np.add.at(normals, shape.faces[:, k], crossed)
    return _Placed(shape.vertices, 0.0, normals / np.linalg.norm(normals, axis=1, keepdims=True))


class TipGaps:
    """Distances between a hand's fingertips for batches of joint positions.

    Parameters
    ----------
    tree : LinkTree
    """

    def __init__(self, tree: LinkTree) -> None:
        self.tree = tree
        self._samples = [_samples(tip) for _, tip in tree.tips]

    def round(self, fingers: Sequence[int]) -> bool:
        """Return whether all given fingertips are round, and so face every direction."""
        return all(self._samples[i].normals is None for i in fingers)

    def moving(self, fingers: Sequence[int]) -> NDArray[np.intp]:
        """Return the numbers of the free joints that move some of the fingertips relative to others."""
        robot = self.tree.robot
        links = [self.tree.tips[i][0] for i in fingers]
        chains: list[set[str]] = [{j.name for j in robot.chain(link) if j.moves} for link in links]
        names = {name for chain in chains for name in chain if not all(name in other for other in chains)}
        drivers = {robot.follows(joint)[0] for joint in robot.joints if joint.name in names}
        return np.array([i for i, j in enumerate(robot.free_joints) if j.name in drivers], dtype=np.intp)

    def distances(self, fingers: Sequence[int], joints: FloatArray, *, facing: bool) -> FloatArray:
        """Return the largest pairwise distance of fingertips, (b,), metres, negative where all overlap.

        Parameters
        ----------
        fingers : sequence of int
        joints : (b, m) array
            Positions of the free joints.
        facing : bool
            Add a penalty for fingertips that do not face each other: the misalignment times the hand's span.
        """
        return self._largest(fingers, joints, self.tree.span if facing else 0.0)[0]

    def turned_away(self, fingers: Sequence[int], joints: FloatArray) -> FloatArray:
        """Return the largest misalignment of any pair, (b,), as a cosine; 0 where all pairs face each other."""
        return self._largest(fingers, joints, self.tree.span)[1]

    def _largest(self, fingers: Sequence[int], joints: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
        """Return the largest distance and the largest misalignment over the pairs, (b,) each."""
        sizes = sorted(len(self._samples[i].points) for i in fingers)
        parts = np.array_split(joints, max(1, -(-len(joints) * sizes[-1] * sizes[-2] // AT_ONCE)))
        found = [self._of_part(fingers, part, weight) for part in parts]
        return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])

    def _of_part(self, fingers: Sequence[int], joints: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
        count = len(joints)
        poses = np.asarray(self.tree.link_function.map(count)(joints.T).full()).reshape(4, count, -1, 4)[:3]
        placed = [self._placed(i, poses) for i in fingers]
        found = [_between(a, b, weight) for a, b in combinations(placed, 2)]
        return np.max([f[0] for f in found], axis=0), np.max([f[1] for f in found], axis=0)

    def _placed(self, i: int, poses: FloatArray) -> _Placed:
        """Return a fingertip's samples for poses (3, b, links, 4) of the used links."""
        pose = poses[:, :, self.tree.used_links.index(self.tree.tips[i][0])]
        samples = self._samples[i]
        points = np.einsum("xba,ma->bmx", pose[..., :3], samples.points) + pose[..., 3].T[:, None]
        normals = None if samples.normals is None else np.einsum("xba,ma->bmx", pose[..., :3], samples.normals)
        return _Placed(points, samples.radius, normals)


def _between(a: _Placed, b: _Placed, weight: float) -> tuple[FloatArray, FloatArray]:
    """Return distance and misalignment, (b,) each, of two fingertips at their best pair of points."""
    between = b.points[:, None] - a.points[:, :, None]  # (b, points of a, points of b, 3)
    length = np.linalg.norm(between, axis=3)
    lack = np.zeros_like(length)
    if weight:
        way = between / np.maximum(length, 1e-12)[..., None]
        for normals, axes, sign in ((a.normals, "bix", -1.0), (b.normals, "bjx", 1.0)):
            if normals is not None:
                askew = ASKEW + sign * np.einsum(f"bijx,{axes}->bij", way, normals)
                lack = np.maximum(lack, np.where(length > CLOSE, askew, 0.0))
        if a.normals is not None and b.normals is not None:
            lack = np.maximum(lack, ASKEW + np.einsum("bix,bjx->bij", a.normals, b.normals))
    count, rows = len(length), np.arange(len(length))
    scores = (length - a.radius - b.radius + weight * lack).reshape(count, -1)
    best = np.argmin(scores, axis=1)
    return scores[rows, best], lack.reshape(count, -1)[rows, best]
