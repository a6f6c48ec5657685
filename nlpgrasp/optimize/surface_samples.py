"""Surface samples of a body, their support tables, and pairs of opposite samples.

``SurfaceSamples`` holds the points that each contact may use. ``SampleTables`` holds the supports of single contacts at
these points along shared directions, for coordinate exchange. Parallel jaws begin with pairs of opposite points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.formatting import vector
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.pad import is_off_normal
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.cell_supports import COMBINATION_RULES, CombinationRule
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandFunctions
from nlpgrasp.problem.candidate_constraints import FITS
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import spread_directions

BODY_SAMPLES, FACE_SAMPLES = 2400, 600  # sample points of a body with faces: in all; per face, at least
MESH_SAMPLES = 20000  # sample points of a mesh
MESH_ANGLE = np.radians(30.0)  # largest angle between mesh normal and smooth normal: avoids sharp edges
PAIRED_POINTS, PAIRING_BLOCK = 1200, 200  # sample points that are paired across the body; block size of the pairing
ASIDE = 1.5  # largest distance of a partner from the line along the normal, in spacings of the points
PARTNERS = 3  # partners per point, at most: those nearest to the line along its normal
TABLE_SAMPLES, PROJECTED_SAMPLES = 2400, 800  # samples of a contact in its support table, at most; without closed form
BAND = 0.05  # allowed violation of equations, relative to their scales; samples are projected afterwards
NEGLIGIBLE = 1e-5  # violation beyond the band, relative to the constraint's scale, that counts as none
METRIC_GRASPS = 256  # random grasps whose wrenches complete the metric of a degenerate task


@dataclass(frozen=True)
class SampleCloud:
    """Surface points with normals, faces and a k-d tree.

    Parameters
    ----------
    faces : (m,) array of str
        The face each point is on.
    points : (m, space) array
        Metres.
    normals : (m, space) array
        Unit, into the body.
    tree : scipy.spatial.cKDTree
    """

    faces: NDArray[np.object_]
    points: FloatArray
    normals: FloatArray
    tree: cKDTree

    def subset(self, indices: IntArray) -> SampleCloud:
        """Return the cloud of the points with given indices (m,)."""
        points = self.points[indices]
        return SampleCloud(self.faces[indices], points, self.normals[indices], cKDTree(points))


class SurfaceSamples:
    """Surface samples of a problem's body, identical in every process.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        self._clouds: dict[tuple[str, ...], SampleCloud] = {}

    @cached_property
    def faces(self) -> dict[str, FloatArray]:
        """Sample points of each face that some contact may use, (m, space), by the face's name."""
        problem, k = self._problem, len(self._problem.models)
        names = sorted({n for i in range(k) for n in problem.allowed_faces(i)})
        rng = np.random.default_rng(0)
        count = max(FACE_SAMPLES, BODY_SAMPLES // len(names))
        samples = {name: problem.body.sample(name, count, rng, problem.margin) for name in names}
        samples = {name: points for name, points in samples.items() if len(points)}
        self._check(samples, "GraspProblem.body", "no point found on {}", "a reachable face")
        if directions := _directions(problem):
            determined = {
                name: points[_determines_direction(directions, problem.body.evaluate(name, points)[2])]
                for name, points in samples.items()
            }
            samples = {name: points for name, points in determined.items() if len(points)}
            given = " and ".join(f"[{vector(direction)}]" for direction in dict.fromkeys(directions))
            field = "GraspProblem.contacts, their direction"
            self._check(samples, field, f"{given}, the normal of {{}}", "a direction along the face")
        return samples

    def _check(self, samples: dict[str, FloatArray], field: str, given: str, expected: str) -> None:
        """Raise an ``InputError`` if none of the faces that some contact may use has samples."""
        for i in range(len(self._problem.models)):
            allowed = self._problem.allowed_faces(i)
            if not any(name in samples for name in allowed):
                raise InputError(field, given.format(", ".join(allowed)), expected)

    def usable_faces(self, contact: int) -> tuple[str, ...]:
        """Return the faces that a contact may use and that have sample points."""
        return tuple(n for n in self._problem.allowed_faces(contact) if n in self.faces)

    def cloud(self, contact: int) -> SampleCloud:
        """Return the surface samples that a contact may use.

        On a mesh they are points of the mesh itself.
        """
        if isinstance(self._problem.body, Mesh):
            return self.mesh_cloud
        names = self.usable_faces(contact)
        if names not in self._clouds:
            points = np.concatenate([self.faces[n] for n in names])
            labels = np.concatenate([np.full(len(self.faces[n]), n, dtype=object) for n in names])
            normals = np.concatenate([-self._problem.body.evaluate(n, self.faces[n])[2] for n in names])
            self._clouds[names] = SampleCloud(labels, points, normals, cKDTree(points))
        return self._clouds[names]

    @property
    def mesh(self) -> Mesh:
        """The problem's body; raises an ``InputError`` unless it is a mesh."""
        return mesh_of(self._problem)

    @cached_property
    def mesh_cloud(self) -> SampleCloud:
        """Points of the mesh itself, away from sharp edges, with its triangles' inward normals."""
        body, (points, normals, usable) = self.mesh, usable_mesh_samples(self._problem)
        if usable.any():
            points, normals = points[usable], normals[usable]
        return SampleCloud(np.full(len(points), body.face_names[0], dtype=object), points, -normals, cKDTree(points))


def mesh_of(problem: GraspProblem) -> Mesh:
    """Return a problem's body; raise an ``InputError`` unless it is a mesh."""
    if not isinstance(problem.body, Mesh):
        raise InputError("GraspProblem.body", type(problem.body).__name__, "a mesh")
    return problem.body


def usable_mesh_samples(problem: GraspProblem) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return points of a problem's mesh (m, 3), their outward normals (m, 3), and the mask of those that are usable."""
    points, normals = mesh_of(problem).surface_samples(MESH_SAMPLES, np.random.default_rng(0))
    return points, normals, is_usable(problem, points, normals)


def is_usable(problem: GraspProblem, points: FloatArray, outward: FloatArray) -> BoolArray:
    """Return the mask of mesh points (m, 3), with outward normals (m, 3), that a contact may use.

    They are at least the margin away from sharp edges, their normals are near those of the smooth surface, and the
    largest fingertip that follows its contact does not overlap the mesh there.
    """
    body, face, hand = mesh_of(problem), problem.body.face_names[0], problem.hand
    usable = np.sum(body.evaluate(face, points)[2] * outward, axis=1) >= np.cos(MESH_ANGLE)
    if directions := _directions(problem):
        usable &= _determines_direction(directions, outward)
    if problem.margin > 0.0:
        usable &= body.edge_distance(face, points) >= problem.margin
    radius = 0.0 if hand is None or not hand.follows_contacts else max(hand.tip_radii)
    if radius > 0.0:
        usable[usable] = body.clearance((points + radius * outward)[usable]) >= FITS * radius
    return np.asarray(usable)


class SampleTables:
    """Tables of the contacts' supports at surface samples along shared directions.

    Parameters
    ----------
    problem : GraspProblem
    clouds : sequence of k SampleCloud
        Samples of each contact.
    rows : ConstraintValues
    hand : HandFunctions
    directions : (j, d) array, optional
        Each with ``phi_A = 1``; well spread for the task if not given.
    most : int
        Samples of a contact whose support has a closed form, at most.

    Attributes
    ----------
    budget : ForceBudget
        The problem's; the L2 budget where that depends on the hand, or the contacts' supports do not combine.
    power : float
        p of ``phi_G^p = sum_i s_i^p`` for the supports of the contacts; 1 where ``phi_G`` is the largest of them.
    combine : numpy.ufunc
        The sum of the powers, or their maximum.
    distinct : list of SampleTable
        Contacts with one model and the same samples share a table.
    of_contact : list of k int
        Index of each contact's table.
    directions : (j, d) array
        Each with ``phi_A = 1``.
    powers : list of (j, m) array
        ``s^p`` of each table along the directions.
    coupled : bool
        Whether some constraints have to be checked on all contacts together.
    """

    def __init__(
        self,
        problem: GraspProblem,
        clouds: Sequence[SampleCloud],
        rows: ConstraintValues,
        hand: HandFunctions,
        directions: FloatArray | None = None,
        most: int = TABLE_SAMPLES,
    ) -> None:
        self.budget: ForceBudget = problem.budget if type(problem.budget) in COMBINATION_RULES else L2Budget()
        rule = CombinationRule.of(self.budget)
        self.power = rule.power
        self.combine: np.ufunc = np.maximum if rule.takes_largest else np.add
        self._models, self._origin = models, origin = problem.models, problem.origin
        self._jaws = isinstance(problem.hand, ParallelJaw)
        allowed = [_satisfying_samples(rows, hand, clouds, i) for i in range(len(models))]
        distinct_contacts, self.of_contact = _distinct_contacts(models, clouds, allowed)
        self.distinct: list[SampleTable] = []
        for i in distinct_contacts:
            limit = most if rule.has_closed_form(models[i]) else PROJECTED_SAMPLES
            samples = _table_samples(clouds[i], allowed[i], limit)
            maps = GraspStack(samples.points[:, None], samples.normals[:, None], [models[i]], origin).G
            self.distinct.append(SampleTable(models[i], rule, samples, np.asarray(maps)))
        on_one_contact = ~rows.dependence_mask[:, -1] & (np.sum(rows.dependence_mask, axis=1) <= 1)
        self.coupled = not (np.all(on_one_contact) and all(mask.any() for mask in allowed))
        if directions is None:
            y = spread_directions(self.grasps(self.random(METRIC_GRASPS, np.random.default_rng(0))), problem.task)
            directions = y / problem.task.support(y)[0][:, None]
        self.directions = directions
        self.powers = [table.powers(self.directions) for table in self.distinct]

    def samples(self, contact: int) -> SampleCloud:
        """Return the surface samples of a contact."""
        return self.distinct[self.of_contact[contact]].samples

    @cached_property
    def pairs(self) -> IntArray:
        """Index pairs of opposite samples, (b, 2), for parallel jaws; empty for other hands."""
        if not (self._jaws and self.of_contact[0] == self.of_contact[1]):
            return np.zeros((0, 2), dtype=np.intp)
        pairs = opposite_pairs(self.samples(0))
        return np.concatenate([pairs, pairs[:, ::-1]])

    def random(self, count: int, rng: np.random.Generator) -> IntArray:
        """Return random tuples of sample indices, one index for each contact, (count, k)."""
        if len(self.pairs):
            return self.pairs[rng.integers(len(self.pairs), size=count)]
        sizes = [len(self.samples(i).points) for i in range(len(self.of_contact))]
        return np.stack([rng.integers(size, size=count) for size in sizes], axis=1)

    def nearest(self, contacts: Sequence[FloatArray]) -> IntArray:
        """Return the tuples of sample indices, (b, k), nearest to the contacts (k, space) of b grasps."""
        tuples = [[self.samples(i).tree.query(point)[1] for i, point in enumerate(points)] for points in contacts]
        return np.array(tuples, dtype=np.intp).reshape(len(contacts), len(self.of_contact))

    def contacts_of(self, tuples: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return contact points and inward normals of tuples of samples (b, k), (b, k, space) each."""
        clouds = [self.samples(i) for i in range(tuples.shape[1])]
        points = np.stack([cloud.points[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)
        return points, np.stack([cloud.normals[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)

    def grasps(self, tuples: IntArray) -> GraspStack:
        """Return the grasps at tuples of samples (b, k)."""
        return GraspStack(*self.contacts_of(tuples), self._models, self._origin)

    def around(self, tuples: IntArray, width: int, count: int, rng: np.random.Generator) -> IntArray:
        """Return tuples (b, count, k) near those of (b, k): most of their contacts are moved at random.

        A contact moves to one of the ``width`` samples nearest to it.
        """
        result = np.repeat(tuples[:, None], count, axis=1)
        moves = rng.random(result.shape) < 0.7
        for i in range(tuples.shape[1]):
            cloud = self.samples(i)
            near = cloud.tree.query(cloud.points[tuples[:, i]], min(width, len(cloud.points)))[1]
            near = near.reshape(len(tuples), -1)
            chosen = np.take_along_axis(near, rng.integers(near.shape[1], size=(len(tuples), count)), axis=1)
            result[:, :, i] = np.where(moves[:, :, i], chosen, result[:, :, i])
        return result


def best_of_trials(tuples: IntArray, trials: IntArray, values: Callable[[IntArray], FloatArray]) -> IntArray:
    """Return the best of each tuple of samples (b, k) and its trials (b, m, k), by the values of tuples."""
    trials = np.concatenate([tuples[:, None], trials], axis=1)
    order = values(trials.reshape(-1, tuples.shape[1])).reshape(trials.shape[:2])
    return np.asarray(trials[np.arange(len(tuples)), np.argmax(order, axis=1)])


@dataclass(frozen=True)
class SampleTable:
    """Samples that satisfy the constraints on one contact alone, with the contact's grasp map at each.

    Parameters
    ----------
    model : ContactModel
    rule : CombinationRule
        Combination of the contacts' supports under the force budget.
    samples : SampleCloud
    maps : (m, d, n) array
    """

    model: ContactModel
    rule: CombinationRule
    samples: SampleCloud
    maps: FloatArray

    def powers(self, y: FloatArray) -> FloatArray:
        """Return ``s^p``, the power of the support, at all samples along directions (j, d), (j, m)."""
        m, d, n = self.maps.shape
        work = (y @ self.maps.transpose(1, 0, 2).reshape(d, m * n)).reshape(len(y), m, n)
        return np.asarray(self.rule.powers(self.model, work), dtype=np.float32)


def opposite_pairs(cloud: SampleCloud) -> IntArray:
    """Return index pairs of opposite points, (b, 2): the second is near the line along the first one's inward normal.

    The line may leave the body and enter it again: each point has up to three partners.

    Parameters
    ----------
    cloud : SampleCloud
        At most 1200 of its points are paired, always the same.
    """
    subset = np.random.default_rng(0).permutation(len(cloud.points))[:PAIRED_POINTS]
    points, normals = cloud.points[subset], cloud.normals[subset]
    nearest_distances = np.asarray(cloud.tree.query(points, k=2)[0])[:, 1]
    spacing = float(np.median(nearest_distances)) * np.sqrt(len(cloud.points) / len(points))
    pairs = []
    for first in range(0, len(points), PAIRING_BLOCK):
        block = slice(first, first + PAIRING_BLOCK)
        differences = points[None] - points[block, None]
        along = np.einsum("ijk,ik->ij", differences, normals[block])
        aside = np.sqrt(np.maximum(np.sum(differences**2, axis=2) - along**2, 0.0))
        faces_back = (along > 0.0) & (aside <= ASIDE * spacing) & (normals[block] @ normals.T < 0.0)
        order = np.argsort(np.where(faces_back, aside, np.inf), axis=1)[:, :PARTNERS]
        rows, columns = np.nonzero(np.take_along_axis(faces_back, order, axis=1))
        partners = order[rows, columns]
        pairs.append(np.stack([subset[block][rows], subset[partners]], axis=1))
    return np.concatenate(pairs)


def _directions(problem: GraspProblem) -> list[tuple[float, ...]]:
    """Return the directions of the problem's line and rectangle contacts."""
    directions = (getattr(model, "direction", None) for model in problem.models) if problem.body.space == 3 else ()
    return [direction for direction in directions if direction is not None]


def _determines_direction(directions: Sequence[tuple[float, ...]], outward: FloatArray) -> BoolArray:
    """Return the mask (m,) of unit normals (m, 3) to which no direction of a line or rectangle is nearly parallel."""
    return np.asarray(np.all([is_off_normal(direction, outward) for direction in directions], axis=0))


def _table_samples(cloud: SampleCloud, allowed: BoolArray, most: int) -> SampleCloud:
    """Return at most ``most`` allowed points of a cloud, or of all its points if none is allowed."""
    indices = np.flatnonzero(allowed if allowed.any() else ~allowed)
    if len(indices) > most:
        indices = np.random.default_rng(0).choice(indices, most, replace=False)
    return cloud.subset(indices)


def _distinct_contacts(
    models: Sequence[ContactModel], clouds: Sequence[SampleCloud], allowed: Sequence[BoolArray]
) -> tuple[list[int], list[int]]:
    """Return the contacts with distinct models or samples, and each contact's index among these.

    Of contacts with one model and the same samples, the first counts.

    Parameters
    ----------
    models : sequence of k ContactModel
    clouds : sequence of k SampleCloud
    allowed : sequence of k (m,) bool arrays
        Mask of each contact's samples in its cloud.
    """
    keys = [(model, id(cloud), mask.tobytes()) for model, cloud, mask in zip(models, clouds, allowed, strict=True)]
    first = [keys.index(key) for key in keys]
    distinct = sorted(set(first))
    return distinct, [distinct.index(i) for i in first]


def _satisfying_samples(
    rows: ConstraintValues, hand: HandFunctions, clouds: Sequence[SampleCloud], contact: int
) -> BoolArray:
    """Return the mask of a contact's samples that satisfy the constraints on that contact alone, (m,)."""
    cloud, count = clouds[contact], len(clouds[contact].points)
    on_contact = rows.dependence_mask[:, contact] & (np.sum(rows.dependence_mask, axis=1) == 1)
    if not on_contact.any():
        return np.ones(count, dtype=bool)
    points, normals = (
        np.repeat(np.stack([getattr(c, key)[0] for c in clouds])[None], count, axis=0) for key in ("points", "normals")
    )
    points[:, contact], normals[:, contact] = cloud.points, cloud.normals
    values = rows.values(points, normals, hand.start(points, normals))
    return np.asarray(np.all(rows.each_violation(values, BAND)[:, on_contact] <= NEGLIGIBLE, axis=1))
