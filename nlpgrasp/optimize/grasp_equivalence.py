"""Equivalence of grasps up to the order of contacts and the problem's symmetries."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.symmetry import is_invariant_task, motions_of, rotation_by_one_radian, wrench_map
from nlpgrasp.hands import PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import draw_contacts

SAME = 1e-6  # tolerance of a symmetry, relative to the body's size and to the constraints' scales
TESTED = 128  # random placements at which a symmetry is tested
POSE = np.radians(30.0)  # radians, rotation of the palm above which two poses are distinct
TINY = 1e-9  # over the body's size: length below which a vector has no direction
Motion = tuple[FloatArray, FloatArray]  # R (space, space), t (space,): p -> R p + t


class GraspEquivalence:
    """Equivalence test for grasps of one problem.

    Parameters
    ----------
    compiled : CompiledProblem
    distinct : float
        Over the body's size: two grasps are distinct when, for every matching of contacts of equal models, a contact is
        farther than that from its match. With a hand that has a pose, also when the palm is that far away, or rotated
        by more than 30 degrees.

    Notes
    -----
    Of a continuous symmetry, those rotations are tried that take one contact (with spherical symmetry two) to a contact
    of the other grasp, then improved by least squares over the matching. A rotation that brings two grasps slightly
    nearer may be missed; they then count as distinct.
    """

    def __init__(self, compiled: CompiledProblem, distinct: float) -> None:
        problem = compiled.problem
        self._hand = problem.hand if isinstance(problem.hand, PosedHand) else None
        self._limit, self._tiny = distinct * problem.body.size, TINY * problem.body.size
        self._symmetries = Symmetries(compiled)
        kinds = [(model, problem.allowed_faces(i)) for i, model in enumerate(problem.models)]
        self._mismatch = np.array([[0.0 if a == b else np.inf for b in kinds] for a in kinds])

    @property
    def distance(self) -> float:
        """Distance of matched contacts above which two grasps are distinct, metres."""
        return self._limit

    def are_equivalent(self, a: GraspCandidate, b: GraspCandidate) -> bool:
        """Return whether two grasps are equivalent."""
        if self._hand is not None and self._have_distinct_poses(
            self._hand.describe(a.hand), self._hand.describe(b.hand)
        ):
            return False
        change = np.abs(_sorted_distances(a.points) - _sorted_distances(b.points))
        if np.max(change, initial=0.0) > 2.0 * self._limit:
            return False  # no motion changes the distances between contacts
        images = self._images(a.points, b.points)
        return any(self._can_match(image, b.points) for image in images)

    def _have_distinct_poses(self, a: Json, b: Json) -> bool:
        """Return whether the palm poses of two postures are distinct."""
        if "palm_pose" not in a:
            return False
        p, q = a["palm_pose"], b["palm_pose"]
        cosine = abs(float(np.dot(p["quaternion_wxyz"], q["quaternion_wxyz"])))
        distance = float(np.linalg.norm(np.subtract(p["position"], q["position"])))
        return distance > self._limit or bool(2.0 * np.arccos(min(cosine, 1.0)) > POSE)

    def _can_match(self, points: FloatArray, others: FloatArray) -> bool:
        """Return whether contacts can be paired with others so that all pairs are within the distance limit."""
        from scipy.optimize import linear_sum_assignment

        within_limit = self._distances(points, others) <= self._limit
        if not (within_limit.any(axis=0).all() and within_limit.any(axis=1).all()):
            return False
        rows, columns = linear_sum_assignment(~within_limit)
        return bool(within_limit[rows, columns].all())

    def _distances(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return the distances between contacts, (k, k), metres; infinite between contacts of unequal models."""
        distances: FloatArray = np.linalg.norm(points[:, None] - others[None], axis=2) + self._mismatch
        return distances

    def _images(self, points: FloatArray, others: FloatArray) -> Iterator[FloatArray]:
        """Yield images of contacts (k, space) under the symmetries.

        Of continuous symmetries only rotations that bring contacts close to ``others`` are tried.
        """
        for rotation, translation in self._symmetries.motions:
            image = points @ rotation.T + translation
            if self._symmetries.axis is None:
                yield image
                continue
            if not self._can_match(self._invariants(image), self._invariants(others)):
                continue
            for rotated in self._rotations_between(image, others):
                yield rotated
                yield self._rotate_to_match(rotated, others)

    def _rotations_between(self, points: FloatArray, others: FloatArray) -> Iterator[FloatArray]:
        """Yield contacts rotated to bring one of them (two for spherical symmetry) nearest to ``others``."""
        if not self._symmetries.is_round:
            radial = self._radial_parts(points)
            first = int(np.argmax(np.linalg.norm(radial, axis=1)))
            for target in self._radial_parts(others)[np.isfinite(self._mismatch[first])]:
                yield points @ self._nearest_rotation(radial[first, None], target[None]).T
            return
        first = 0
        second = int(np.argmax(np.linalg.norm(np.cross(points, points[first]), axis=1)))
        for i in np.flatnonzero(np.isfinite(self._mismatch[first])):
            for j in np.flatnonzero(np.isfinite(self._mismatch[second])):
                if i != j:
                    yield points @ self._nearest_rotation(points[[first, second]], others[[i, j]]).T

    def _rotate_to_match(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return contacts rotated to fit their matches among ``others`` in the least-squares sense."""
        from scipy.optimize import linear_sum_assignment

        cost = np.minimum(self._distances(points, others), 1e6 * self._limit)
        rows, columns = linear_sum_assignment(cost**2)
        return np.asarray(points @ self._nearest_rotation(points[rows], others[columns]).T)

    def _nearest_rotation(self, points: FloatArray, others: FloatArray) -> FloatArray:
        """Return the symmetry rotation, (3, 3), that fits points to others in the least-squares sense."""
        if self._symmetries.is_round:
            U, _, Vt = np.linalg.svd(others.T @ points)
            handedness = np.sign(np.linalg.det(U @ Vt))
            return np.asarray(U @ np.diag([1.0, 1.0, handedness]) @ Vt)
        axis = self._symmetries.axis
        if axis is None:
            return np.eye(3)
        p, q = self._radial_parts(points), self._radial_parts(others)
        sine, cosine = float(np.sum(np.cross(p, q) @ axis)), float(np.sum(p * q))
        size = float(np.hypot(sine, cosine))
        if size <= self._tiny**2:
            return np.eye(3)
        cross = np.cross(np.eye(3), axis)  # matrix of the cross product with the axis
        along = np.outer(axis, axis)
        return along + (cosine * (np.eye(3) - along) + sine * cross) / size

    def _invariants(self, points: FloatArray) -> FloatArray:
        """Return rotation-invariant coordinates of points (m, 3): radius and height, or distance from the origin."""
        axis = self._symmetries.axis
        if axis is None or self._symmetries.is_round:
            return np.asarray(np.linalg.norm(points, axis=1, keepdims=True))
        return np.column_stack([np.linalg.norm(self._radial_parts(points), axis=1), points @ axis])

    def _radial_parts(self, points: FloatArray) -> FloatArray:
        """Return the components of points (m, 3) orthogonal to the symmetry axis; unchanged without an axis."""
        axis = self._symmetries.axis
        return points if axis is None else points - np.outer(points @ axis, axis)


class Symmetries:
    """Symmetries shared by body, task, allowed contact regions and constraints.

    The motions tested are those of the branch and bound (signed permutations of the axes, those of a polygon's corners)
    and rotations about the coordinate axes. Random placements show whether they leave body and constraints unchanged;
    the task is tested exactly. No symmetries are computed for meshes, a hand with a pose of its own, force budgets that
    depend on the contact frames, or contacts with a direction.

    Parameters
    ----------
    compiled : CompiledProblem

    Attributes
    ----------
    motions : list of (rotation, translation)
        One of each class up to continuous rotation, the identity first.
    axis : (3,) array or None
        Axis of a continuous rotational symmetry.
    is_round : bool
        Whether every rotation is a symmetry.
    """

    def __init__(self, compiled: CompiledProblem) -> None:
        problem = compiled.problem
        space = problem.body.space
        zero = np.zeros(space)
        self.motions: list[Motion] = [(np.eye(space), zero)]
        self.axis: FloatArray | None = None
        self.is_round = False
        has_directions = any(model.turned(np.eye(space)) is not model for model in problem.models)
        if (
            not compiled.follows_contacts
            or problem.budget.depends_on_frames
            or has_directions
            or isinstance(problem.body, Mesh)
        ):
            return
        self._compiled = compiled
        drawn = draw_contacts(compiled, TESTED, np.random.default_rng(0))
        self._drawn = drawn.points, drawn.normals, self._violations(drawn.points, drawn.normals)
        axes = [axis for axis in np.eye(3) if space == 3 and self._is_symmetry(rotation_by_one_radian(axis), zero)]
        self.axis, self.is_round = axes[0] if axes else None, len(axes) > 1
        for rotation, translation in motions_of(problem.body):
            is_known = any(self._kind(rotation, translation) == self._kind(*motion) for motion in self.motions)
            if not is_known and self._is_symmetry(rotation, translation):
                self.motions.append((rotation, translation))
        del self._compiled, self._drawn  # only the symmetries are kept: compiled programs take megabytes

    def _kind(self, rotation: FloatArray, translation: FloatArray) -> tuple[float, ...]:
        """Return a key shared by motions that differ only by a continuous symmetry rotation."""
        handedness = float(np.round(np.linalg.det(rotation)))
        if self.is_round:
            return (handedness,)
        if self.axis is not None:
            return handedness, float(np.round(self.axis @ rotation @ self.axis))
        return (*rotation.ravel().tolist(), *translation.tolist())

    def _is_symmetry(self, rotation: FloatArray, translation: FloatArray) -> bool:
        """Return whether a motion leaves task, allowed contact regions and constraints unchanged."""
        problem = self._compiled.problem
        shift = float(np.max(np.abs(rotation @ problem.origin + translation - problem.origin)))
        if shift > SAME * problem.body.size or not is_invariant_task(problem.task, wrench_map(rotation)):
            return False
        points, normals, violations = self._drawn
        images = points @ rotation.T + translation
        contacts = {
            self._compiled.surface.usable_faces(i): i for i in range(len(problem.models))
        }  # one of each set of faces
        if not all(self._are_allowed(faces, images[:, i]) for faces, i in contacts.items()):
            return False
        image_violations = self._violations(images, normals @ rotation.T)
        return bool(np.all(np.abs(image_violations - violations) <= SAME * (1.0 + violations)))

    def _are_allowed(self, faces: Sequence[str], points: FloatArray) -> bool:
        """Return whether each of the points (m, space) is on one of the given faces."""
        body, margin = self._compiled.problem.body, self._compiled.problem.margin
        is_on = np.zeros(len(points), dtype=bool)
        for face in faces:
            is_on |= body.is_on(face, points, margin)
        return bool(np.all(is_on))

    def _violations(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the largest constraint violation of each placement, relative to the constraints' scales, (b,)."""
        hand = self._compiled.hand_functions.start(points, normals)
        return np.asarray(self._compiled.rows.violations(points, normals, hand))


def _sorted_distances(points: FloatArray) -> FloatArray:
    """Return the sorted distances between all pairs of points (k, space), metres."""
    i, j = np.triu_indices(len(points), 1)
    return np.asarray(np.sort(np.linalg.norm(points[i] - points[j], axis=1)))
