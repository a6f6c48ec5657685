"""Fingertip opposition: least distances between fingertips over the joint ranges, face to face or not.

A random search with shrinking steps: its least distances are upper bounds, in practice close. Collisions between links
are ignored, so other links may prevent a meeting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.tips import HullTip, Tip, dome

SIDES, HULL_SIDES = 9, 16  # sides of the triangulation of a flat or ellipsoidal patch, and of a hull's
FACING_COSINE = np.cos(np.radians(30.0))  # cosine of the largest angle at which patches count as facing each other
MIN_LENGTH = 2e-3  # metres: the direction between nearer points is not used
BATCH_PAIRS = 2_000_000  # pairs of points in a batch
TOUCH = 1e-3  # metres between fingertips that count as touching
MEETING_DISTANCE = 0.01  # metres between fingertips that meet in a set; twice the largest radius if that is more
MAX_TIPS = 6  # largest number of fingertips of which all sets are checked
SAMPLES, KEPT_SAMPLES = 1024, 24  # random postures, and the best of them that are refined
ROUNDS, SHRINK = 16, 0.6  # rounds of refinement, and the factor of the step in each
FACING_ROUNDS = 6  # of the search for a posture in which fingertips face each other, at any distance
FIRST_WIDTH = 0.25  # share of the joint ranges: standard deviation about a posture in the first round


def opposition(tree: LinkTree, rest_posture: FloatArray) -> Opposition:
    """Return the opposition of a hand's fingertips: least distances of pairs, and groups that cannot meet.

    Parameters
    ----------
    tree : LinkTree
    rest_posture : (m,) array
        Positions of the free joints, kept for those that do not move the fingertips in question.
    """
    distances = TipDistances(tree)
    count = len(tree.tips)
    pairs = tuple(_least_distances(distances, pair, rest_posture) for pair in combinations(range(count), 2))
    meeting_distance = max(MEETING_DISTANCE, 2.0 * max((tip.standoff for _, tip in tree.tips), default=0.0))
    meeting_sets = {p.fingers for p in pairs if p.opposed <= meeting_distance}
    separated = []
    for size in range(3, count + 1 if count <= MAX_TIPS else 0):
        for fingers in combinations(range(count), size):
            if all(part in meeting_sets for part in combinations(fingers, size - 1)):
                meeting = _least_distances(distances, fingers, rest_posture)
                if meeting.opposed <= meeting_distance:
                    meeting_sets.add(fingers)
                else:
                    separated.append(meeting)
    return Opposition(pairs, tuple(separated), meeting_distance)


def opposed_tips(tree: LinkTree, rest_posture: FloatArray) -> tuple[int, ...]:
    """Return the fingertips that face another fingertip in some posture; arguments as in ``opposition``."""
    distances = TipDistances(tree)
    alignment = mean_alignment(tree, tree.random_joints(SAMPLES, np.random.default_rng(0)))
    opposed: set[int] = set()
    for pair in sorted(combinations(range(len(tree.tips)), 2), key=lambda pair: float(alignment[pair])):
        if not opposed.issuperset(pair) and _can_face(distances, pair, rest_posture):
            opposed.update(pair)
    return tuple(sorted(opposed))


def mean_alignment(tree: LinkTree, joints: FloatArray) -> FloatArray:
    """Return the mean cosine of the angle between the facing directions of each two fingertips, (k, k).

    The mean is over positions (b, m) of the free joints. A patch faces along the outward normal of its middle; a round
    one has none, and its cosines are zero.
    """
    poses = tree.palm_poses(joints)
    directions = np.zeros((len(joints), len(tree.tips), 3))
    for i, (link, tip) in enumerate(tree.tips):
        facing = getattr(tip, "facing", None) if tip.normal is None else tip.normal
        if facing is not None:
            directions[:, i] = poses[:, tree.used_links.index(link), :3, :3] @ np.asarray(facing)
    return np.asarray(np.einsum("bix,bjx->ij", directions, directions) / len(joints))


@dataclass(frozen=True)
class Opposition:
    """Opposition of fingertips: pairs that can meet, and groups that cannot.

    Parameters
    ----------
    pairs : tuple of TipMeeting
        All pairs of fingertips.
    separated : tuple of TipMeeting
        Minimal sets of more than two fingertips that do not meet at once, although all smaller sets do.
    meeting_distance : float
        Largest distance of fingertips that count as meeting, metres.
    """

    pairs: tuple[TipMeeting, ...]
    separated: tuple[TipMeeting, ...]
    meeting_distance: float

    @property
    def unopposed(self) -> tuple[int, ...]:
        """Fingertips that touch no other fingertip face to face in any posture."""
        fingers = sorted({i for pair in self.pairs for i in pair.fingers})
        return tuple(i for i in fingers if not any(p.touches for p in self.pairs if i in p.fingers))


@dataclass(frozen=True)
class TipMeeting:
    """Least distances between two or more fingertips.

    Parameters
    ----------
    fingers : tuple of int
        Numbers of the contacts.
    nearest : float
        Least distance between the surfaces of two fingertips, metres, 0 where they touch; for more, the least value of
        their largest pairwise distance.
    opposed : float
        The same with the two facing each other; infinite where they never do. For more than two facing is not required.
    joints : (m,) array
        Positions of the free joints there: opposed where that is possible.
    """

    fingers: tuple[int, ...]
    nearest: float
    opposed: float
    joints: FloatArray

    @property
    def faces(self) -> bool:
        """Whether two fingertips face each other in some posture; always true of more than two."""
        return bool(np.isfinite(self.opposed))

    @property
    def touches(self) -> bool:
        """Whether two fingertips can touch face to face, or more than two can touch at once."""
        return self.opposed <= TOUCH


def _least_distances(distances: TipDistances, fingers: tuple[int, ...], rest_posture: FloatArray) -> TipMeeting:
    """Return the least distances between given fingertips, over all postures."""
    if len(fingers) > 2:
        joints, value = _closest_posture(distances, fingers, rest_posture, facing=False)
        return TipMeeting(fingers, value, value, joints)
    joints, value = _closest_posture(distances, fingers, rest_posture, facing=True)
    opposed = value if np.all(distances.largest_misalignment(fingers, joints[None]) <= 0.0) else np.inf
    if distances.round(fingers) or value <= TOUCH:
        return TipMeeting(fingers, opposed, opposed, joints)
    unfacing_joints, nearest = _closest_posture(distances, fingers, rest_posture, facing=False)
    nearest = min(nearest, opposed)
    return TipMeeting(fingers, nearest, opposed, joints if np.isfinite(opposed) else unfacing_joints)


def _closest_posture(
    distances: TipDistances, fingers: Sequence[int], rest_posture: FloatArray, *, facing: bool
) -> tuple[FloatArray, float]:
    """Return the joint positions (m,) at which given fingertips are closest, and their distance."""

    def objective(joints: FloatArray) -> FloatArray:
        return distances.distances(fingers, joints, facing=facing)

    joints, _ = _random_search(distances, fingers, rest_posture, objective, ROUNDS)
    return joints, max(0.0, float(objective(joints[None])[0]))


def _can_face(distances: TipDistances, fingers: Sequence[int], rest_posture: FloatArray) -> bool:
    """Return whether two fingertips face each other in some posture."""

    def objective(joints: FloatArray) -> FloatArray:
        return distances.largest_misalignment(fingers, joints)

    return _random_search(distances, fingers, rest_posture, objective, FACING_ROUNDS)[1] <= 0.0


def _random_search(
    distances: TipDistances,
    fingers: Sequence[int],
    rest_posture: FloatArray,
    objective: Callable[[FloatArray], FloatArray],
    rounds: int,
) -> tuple[FloatArray, float]:
    """Return joint positions (m,) of least objective, and the objective, by random search with shrinking steps.

    It ends at an objective of zero or less.
    """
    rng = np.random.default_rng(0)
    lower, upper = distances.tree.joint_limits
    moving = distances.moving(fingers)
    joints = np.repeat(rest_posture[None], SAMPLES, axis=0)
    joints[:, moving] = rng.uniform(lower[moving], upper[moving], (SAMPLES, len(moving)))
    joints = distances.tree.close(joints)
    values = objective(joints)
    width = FIRST_WIDTH
    for _ in range(rounds if len(moving) else 0):
        best = np.argsort(values, kind="stable")[:KEPT_SAMPLES]
        joints, values = joints[best], values[best]
        if values[0] <= 0.0:
            break
        perturbed = np.repeat(joints, SAMPLES // KEPT_SAMPLES // 2, axis=0)
        steps = width * (upper - lower)[moving] * rng.standard_normal((len(perturbed), len(moving)))
        perturbed[:, moving] = np.clip(perturbed[:, moving] + steps, lower[moving], upper[moving])
        perturbed = distances.tree.close(perturbed)
        joints = np.concatenate([joints, perturbed])
        values = np.concatenate([values, objective(perturbed)])
        width *= SHRINK
    index = int(np.argmin(values))
    return joints[index], float(values[index])


class TipDistances:
    """Evaluator of distances between a hand's fingertips for batches of joint positions.

    Parameters
    ----------
    tree : LinkTree
    """

    def __init__(self, tree: LinkTree) -> None:
        self.tree = tree
        self._samples = [_patch_samples(tip) for _, tip in tree.tips]

    def round(self, fingers: Sequence[int]) -> bool:
        """Return whether all given fingertips are round, so that they face every direction."""
        return all(self._samples[i].normals is None for i in fingers)

    def moving(self, fingers: Sequence[int]) -> IntArray:
        """Return the indices of the free joints that move some of the fingertips relative to others."""
        robot = self.tree.robot
        links = [self.tree.tips[i][0] for i in fingers]
        chains: list[set[str]] = [{j.name for j in robot.chain(link) if j.moves} for link in links]
        names = {name for chain in chains for name in chain if not all(name in other for other in chains)}
        drivers = {robot.driving_joint(joint)[0] for joint in robot.joints if joint.name in names}
        return np.array([i for i, j in enumerate(robot.free_joints) if j.name in drivers], dtype=np.intp)

    def distances(self, fingers: Sequence[int], joints: FloatArray, *, facing: bool) -> FloatArray:
        """Return the largest pairwise distance between given fingertips, (b,), metres, negative if all overlap.

        Parameters
        ----------
        fingers : sequence of int
        joints : (b, m) array
            Positions of the free joints.
        facing : bool
            Add a penalty for fingertips that do not face each other: the misalignment times the hand's span.
        """
        return self._largest(fingers, joints, self.tree.span if facing else 0.0)[0]

    def largest_misalignment(self, fingers: Sequence[int], joints: FloatArray) -> FloatArray:
        """Return the largest misalignment (b,) over all pairs of given fingertips; 0 if all face each other.

        It is the shortfall of a cosine from ``FACING_COSINE``, between the closest points of a pair.
        """
        return self._largest(fingers, joints, self.tree.span)[1]

    def _largest(self, fingers: Sequence[int], joints: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
        """Return the largest distance and the largest misalignment over all pairs, (b,) each."""
        sizes = sorted(len(self._samples[i].points) for i in fingers)
        chunks = np.array_split(joints, max(1, -(-len(joints) * sizes[-1] * sizes[-2] // BATCH_PAIRS)))
        batches = [self._chunk_distances(fingers, chunk, weight) for chunk in chunks]
        return np.concatenate([batch[0] for batch in batches]), np.concatenate([batch[1] for batch in batches])

    def _chunk_distances(
        self, fingers: Sequence[int], joints: FloatArray, weight: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the largest distance and misalignment over all pairs, (b,) each, for one batch of joint positions."""
        poses = self.tree.palm_poses(joints)
        placed = [self._samples_at(i, poses) for i in fingers]
        pair_distances = [_closest_points(a, b, weight) for a, b in combinations(placed, 2)]
        lengths, misalignments = zip(*pair_distances, strict=True)
        return np.max(lengths, axis=0), np.max(misalignments, axis=0)

    def _samples_at(self, i: int, poses: FloatArray) -> _PatchSamples:
        """Return the sample points of a fingertip, given poses (b, links, 4, 4) of the used links."""
        pose = poses[:, self.tree.used_links.index(self.tree.tips[i][0])]
        samples, rotations = self._samples[i], pose[:, :3, :3]
        points = np.einsum("bxa,ma->bmx", rotations, samples.points) + pose[:, None, :3, 3]
        normals = None if samples.normals is None else np.einsum("bxa,ma->bmx", rotations, samples.normals)
        return _PatchSamples(points, samples.radius, normals)


@dataclass(frozen=True)
class _PatchSamples:
    """Sample points of a fingertip patch, radius of its ball, and outward normals unless the patch is round.

    Arrays are (m, 3) in the link's frame, (b, m, 3) in the palm's in b postures.
    """

    points: FloatArray
    radius: float
    normals: FloatArray | None


def _patch_samples(tip: Tip) -> _PatchSamples:
    """Return the sample points of a fingertip patch, in the link's frame."""
    if tip.standoff > 0.0:
        return _PatchSamples(tip.backbone, tip.standoff, None)
    if isinstance(tip, HullTip):  # the normals at its edges are its own, not those of the triangles beside them
        normals = dome(np.asarray(tip.facing), tip.angle, HULL_SIDES).vertices[HULL_SIDES - 1 :]
        return _PatchSamples(tip.points_with_normals(normals), 0.0, normals)
    shape = tip.surface(SIDES)
    corners = shape.vertices[shape.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(shape.vertices)
    for k in range(3):
        np.add.at(normals, shape.faces[:, k], crossed)
    return _PatchSamples(shape.vertices, 0.0, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _closest_points(a: _PatchSamples, b: _PatchSamples, weight: float) -> tuple[FloatArray, FloatArray]:
    """Return distance and misalignment, (b,) each, of the best pair of sample points of two fingertips."""
    differences = b.points[:, None] - a.points[:, :, None]  # (b, points of a, points of b, 3)
    lengths = np.linalg.norm(differences, axis=3)
    misalignments = np.zeros_like(lengths)
    if weight:
        directions = differences / np.maximum(lengths, 1e-12)[..., None]
        for normals, axes, sign in ((a.normals, "bix", -1.0), (b.normals, "bjx", 1.0)):
            if normals is not None:
                misaligned = FACING_COSINE + sign * np.einsum(f"bijx,{axes}->bij", directions, normals)
                misalignments = np.maximum(misalignments, np.where(lengths > MIN_LENGTH, misaligned, 0.0))
        if a.normals is not None and b.normals is not None:
            misalignments = np.maximum(misalignments, FACING_COSINE + np.einsum("bix,bjx->bij", a.normals, b.normals))
    count, postures = len(lengths), np.arange(len(lengths))
    scores = (lengths - a.radius - b.radius + weight * misalignments).reshape(count, -1)
    best = np.argmin(scores, axis=1)
    return scores[postures, best], misalignments.reshape(count, -1)[postures, best]
