"""Equivalence of two grasps: matching contacts up to order and the problem's symmetries."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.symmetry import leaves_invariant, motions_of, unit_rotation, wrench_map
from nlpgrasp.hands import PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import draw_contacts

SAME = 1e-6  # tolerance of a symmetry, relative to the body's size and to the constraints' scales
LOOKED_AT = 128  # random placements at which a symmetry is tested
POSE = np.radians(30.0)  # rotation of the palm above which two poses are distinct
TINY = 1e-9  # over the body's size: shorter vectors have no direction
Motion = tuple[FloatArray, FloatArray]  # R (space, space), t (space,): p -> R p + t


class GraspEquivalence:
    """Equivalence test for grasps of one problem.

    Parameters
    ----------
    compiled : CompiledProblem
    distinct : float
        Of the body's size: two grasps are distinct when, however the contacts of equal models are matched, one of them
        is farther than that from its match. With a hand that has a pose, also when the palm is that far away, or turned
        by more than 30 degrees.

    Notes
    -----
    Where everything can be turned by any angle, the turns tried are those that take one contact (on a body that is
    round all over: two) to where the other grasp has one, each then improved by least squares over its matching: a
    turn that brings two grasps a little nearer may be missed, and they count as two.
    """

    def __init__(self, compiled: CompiledProblem, distinct: float) -> None:
        problem = compiled.problem
        self._hand = problem.hand if isinstance(problem.hand, PosedHand) else None
        self._limit, self._tiny = distinct * problem.body.size, TINY * problem.body.size
        self._symmetries = Symmetries(compiled)
        kinds = [(model, problem.allowed_faces(i)) for i, model in enumerate(problem.models)]
        self._apart = np.array([[0.0 if one == other else np.inf for other in kinds] for one in kinds])

    def alike(self, one: GraspCandidate, other: GraspCandidate) -> bool:
        """Return whether two grasps are equivalent."""
        if self._hand is not None and self._posed_apart(self._hand.describe(one.hand), self._hand.describe(other.hand)):
            return False
        if (
            np.max(np.abs(_sorted_distances(one.points) - _sorted_distances(other.points)), initial=0.0)
            > 2.0 * self._limit
        ):
            return False  # whatever the motion: distances between contacts stay
        images = self._images(one.points, other.points)
        return any(self._matched(image, other.points) for image in images)

    def _posed_apart(self, one: Json, other: Json) -> bool:
        if "palm_pose" not in one:
            return False
        p, q = one["palm_pose"], other["palm_pose"]
        cosine = abs(float(np.dot(p["quaternion_wxyz"], q["quaternion_wxyz"])))
        off = float(np.linalg.norm(np.subtract(p["position"], q["position"])))
        return off > self._limit or bool(2.0 * np.arccos(min(cosine, 1.0)) > POSE)

    def _matched(self, points: FloatArray, others: FloatArray) -> bool:
        """Return whether contacts can be matched so that each is within the limit of its match."""
        from scipy.optimize import linear_sum_assignment

        near = self._distances(points, others) <= self._limit
        if not (near.any(axis=0).all() and near.any(axis=1).all()):
            return False
        rows, columns = linear_sum_assignment(~near)
        return bool(near[rows, columns].all())

    def _distances(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return the distances between contacts, (k, k), metres; infinite for those of other models."""
        found: FloatArray = np.linalg.norm(points[:, None] - others[None], axis=2) + self._apart
        return found

    def _images(self, points: FloatArray, others: FloatArray) -> Iterator[FloatArray]:
        """Yield images of contacts (k, space) under the problem's symmetries, of turns those that come near others."""
        known = self._symmetries
        for rotation, translation in known.motions:
            image = points @ rotation.T + translation
            if known.axis is None:
                yield image
                continue
            if not self._matched(self._invariants(image), self._invariants(others)):
                continue
            for turned in self._rotations_between(image, others):
                yield turned
                yield self._nearest(turned, others)

    def _rotations_between(self, points: FloatArray, others: FloatArray) -> Iterator[FloatArray]:
        """Yield turns of contacts that take one of them, or two, to where others are."""
        if not self._symmetries.is_round:
            beside = self._beside_axis(points)
            first = int(np.argmax(np.linalg.norm(beside, axis=1)))
            for target in self._beside_axis(others)[np.isfinite(self._apart[first])]:
                yield points @ self._nearest_turn(beside[first, None], target[None]).T
            return
        first = 0
        second = int(np.argmax(np.linalg.norm(np.cross(points, points[first]), axis=1)))
        for i in np.flatnonzero(np.isfinite(self._apart[first])):
            for j in np.flatnonzero(np.isfinite(self._apart[second])):
                if i != j:
                    yield points @ self._nearest_turn(points[[first, second]], others[[i, j]]).T

    def _nearest(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return contacts turned to where their matches are nearest in the sense of least squares."""
        from scipy.optimize import linear_sum_assignment

        cost = np.minimum(self._distances(points, others), 1e6 * self._limit)
        rows, columns = linear_sum_assignment(cost**2)
        return np.asarray(points @ self._nearest_turn(points[rows], others[columns]).T)

    def _nearest_turn(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return the proper rotation, (3, 3), about the axis if there is but one, nearest in least squares."""
        if self._symmetries.is_round:
            U, _, Vt = np.linalg.svd(others.T @ points)
            handed = np.sign(np.linalg.det(U @ Vt))
            return np.asarray(U @ np.diag([1.0, 1.0, handed]) @ Vt)
        axis = self._symmetries.axis
        if axis is None:
            return np.eye(3)
        p, q = self._beside_axis(points), self._beside_axis(others)
        sine, cosine = float(np.sum(np.cross(p, q) @ axis)), float(np.sum(p * q))
        size = float(np.hypot(sine, cosine))
        if size <= self._tiny**2:
            return np.eye(3)
        across = np.cross(np.eye(3), axis)  # the matrix of the cross product with the axis
        along = np.outer(axis, axis)
        return along + (cosine * (np.eye(3) - along) + sine * across) / size

    def _invariants(self, points: FloatArray) -> FloatArray:
        """Return what no turn changes of points (m, 3): distance from the axis and height, or from the origin."""
        axis = self._symmetries.axis
        if axis is None or self._symmetries.is_round:
            return np.asarray(np.linalg.norm(points, axis=1, keepdims=True))
        return np.column_stack([np.linalg.norm(self._beside_axis(points), axis=1), points @ axis])

    def _beside_axis(self, points: FloatArray) -> FloatArray:
        """Return the parts of points (m, 3) across the axis."""
        axis = self._symmetries.axis
        return points if axis is None else points - np.outer(points @ axis, axis)


class Symmetries:
    """Symmetries shared by body, task, allowed contact regions and constraints.

    Bodies are tried with the motions that the search of all placements knows (signed permutations of the axes, those
    of a polygon's corners) and with turns about the coordinate axes; whether body and constraints stay as they are is
    told by points and placements at random, whether the task does by itself. None are known of meshes, of a hand with a
    pose of its own, of force budgets that depend on the contact frames, or of contacts with a direction.

    Parameters
    ----------
    compiled : CompiledProblem

    Attributes
    ----------
    motions : list of (rotation, translation)
        One of each kind that turns do not tell apart, the identity first.
    axis : (3,) array or None
        About which everything can be turned by any angle.
    is_round : bool
        Whether it can be turned about any axis.
    """

    def __init__(self, compiled: CompiledProblem) -> None:
        problem = compiled.problem
        space = problem.body.space
        self._bench, nothing = compiled, np.zeros(space)
        self.motions: list[Motion] = [(np.eye(space), nothing)]
        self.axis: FloatArray | None = None
        self.is_round = False
        directed = any(model.turned(np.eye(space)) is not model for model in problem.models)
        if (
            not compiled.follows_contacts
            or problem.budget.depends_on_frames
            or directed
            or isinstance(problem.body, Mesh)
        ):
            return
        drawn = draw_contacts(compiled, LOOKED_AT, np.random.default_rng(0))
        self._drawn = drawn.points, drawn.normals, self._violations(drawn.points, drawn.normals)
        axes = [axis for axis in np.eye(3) if space == 3 and self._is_symmetry(unit_rotation(axis), nothing)]
        self.axis, self.is_round = axes[0] if axes else None, len(axes) > 1
        for rotation, translation in motions_of(problem.body):
            known = any(self._kind(rotation, translation) == self._kind(*motion) for motion in self.motions)
            if not known and self._is_symmetry(rotation, translation):
                self.motions.append((rotation, translation))

    def _kind(self, rotation: FloatArray, translation: FloatArray) -> tuple[float, ...]:
        """Return a key that is equal for motions that differ by a continuous rotation alone."""
        handed = float(np.round(np.linalg.det(rotation)))
        if self.is_round:
            return (handed,)
        if self.axis is not None:
            return handed, float(np.round(self.axis @ rotation @ self.axis))
        return (*rotation.ravel().tolist(), *translation.tolist())

    def _is_symmetry(self, rotation: FloatArray, translation: FloatArray) -> bool:
        """Return whether a motion leaves task, allowed contact regions and constraints unchanged."""
        problem = self._bench.problem
        moved = float(np.max(np.abs(rotation @ problem.origin + translation - problem.origin)))
        if moved > SAME * problem.body.size or not leaves_invariant(problem.task, wrench_map(rotation)):
            return False
        points, normals, violations = self._drawn
        images = points @ rotation.T + translation
        places = {self._bench.surface.usable(i): i for i in range(len(problem.models))}
        if not all(self._are_allowed(names, images[:, i]) for names, i in places.items()):
            return False
        after = self._violations(images, normals @ rotation.T)
        return bool(np.all(np.abs(after - violations) <= SAME * (1.0 + violations)))

    def _are_allowed(self, faces: Sequence[str], points: FloatArray) -> bool:
        """Return whether each of the points (m, space) is on one of some faces."""
        body, margin = self._bench.problem.body, self._bench.problem.margin
        on = np.zeros(len(points), dtype=bool)
        for face in faces:
            on |= body.is_on(face, points, margin)
        return bool(np.all(on))

    def _violations(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return each placement's largest constraint violation, (b, k, space) to (b,), relative to the scales."""
        hand = self._bench.hand_points.start(points, normals)
        return np.asarray(self._bench.rows.violations(points, normals, hand))


def _sorted_distances(points: FloatArray) -> FloatArray:
    """Return the distances between each two of the points (k, space), sorted, metres."""
    i, j = np.triu_indices(len(points), 1)
    return np.asarray(np.sort(np.linalg.norm(points[i] - points[j], axis=1)))
