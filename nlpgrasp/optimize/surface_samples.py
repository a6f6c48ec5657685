"""Surface samples of a body, their support tables, and pairs of opposite samples.

``SurfaceSamples`` holds the points that each contact may use. ``SampleTables`` holds the supports of single contacts at
these points along shared directions, for coordinate exchange. Parallel jaws begin with pairs of opposite points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.pad import is_off_normal
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.cell_supports import MEASURES, Measure
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandPoints
from nlpgrasp.problem.candidate_constraints import FITS
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import spread_directions

CLOUD, LEAST = 2400, 600  # sample points of a body with faces: in all; per face, at least
MESH_SAMPLES = 20000  # sample points of a mesh
MESH_ANGLE = np.radians(30.0)  # most between mesh normal and smooth normal: avoids sharp edges
POINTS, BLOCK = 1200, 200  # sample points that are paired across the body; block size of the pairing
ASIDE = 1.5  # largest distance of a partner from the line along the normal, in spacings of the points
PARTNERS = 3  # partners per point, at most: those nearest to its line
SAMPLES = 2400  # samples of a contact in its support table, at most
BAND = 0.05  # allowed violation of equations, relative to their scales; samples are projected afterwards
KEEPS = 1e-5  # violation beyond this band, relative to the constraint's scale, that counts as none
SHAPED_BY = 256  # random grasps whose wrenches complete the metric of a degenerate task
IntArray = NDArray[np.intp]


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

    def subset(self, kept: NDArray[np.intp]) -> SampleCloud:
        """Return the points with these numbers (m,)."""
        points = self.points[kept]
        return SampleCloud(self.faces[kept], points, self.normals[kept], cKDTree(points))


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
        """Points on each face that some contact may use, (m, space)."""
        problem, k = self._problem, len(self._problem.models)
        names = sorted({n for i in range(k) for n in problem.allowed_faces(i)})
        rng = np.random.default_rng(0)
        count = max(LEAST, CLOUD // len(names))
        found = {name: problem.body.sample(name, count, rng, problem.margin) for name in names}
        found = {name: points for name, points in found.items() if len(points)}
        if directions := _directions(problem):
            told = {
                n: _determines_direction(directions, problem.body.evaluate(n, points)[2]) for n, points in found.items()
            }
            found = {name: points[told[name]] for name, points in found.items() if np.any(told[name])}
        for i in range(k):
            if not any(n in found for n in problem.allowed_faces(i)):
                raise InputError(
                    "GraspProblem.body", f"no point found on {problem.allowed_faces(i)}", "a reachable face"
                )
        return found

    def usable(self, contact: int) -> tuple[str, ...]:
        """Return the faces that a contact may use and that have points."""
        return tuple(n for n in self._problem.allowed_faces(contact) if n in self.faces)

    def cloud(self, contact: int) -> SampleCloud:
        """Return the points that a contact may use: of a mesh those of the mesh itself."""
        if isinstance(self._problem.body, Mesh):
            return self.mesh_cloud
        names = self.usable(contact)
        if names not in self._clouds:
            points = np.concatenate([self.faces[n] for n in names])
            labels = np.concatenate([np.full(len(self.faces[n]), n, dtype=object) for n in names])
            normals = np.concatenate([-self._problem.body.evaluate(n, self.faces[n])[2] for n in names])
            self._clouds[names] = SampleCloud(labels, points, normals, cKDTree(points))
        return self._clouds[names]

    @property
    def mesh(self) -> Mesh:
        """The body, which must be a mesh."""
        return mesh_of(self._problem)

    @cached_property
    def mesh_cloud(self) -> SampleCloud:
        """Points of the mesh itself, away from sharp edges, with its triangles' inward normals."""
        body = self.mesh
        points, normals = body.surface_samples(MESH_SAMPLES, np.random.default_rng(0))
        kept = is_usable(self._problem, points, normals)
        if kept.any():
            points, normals = points[kept], normals[kept]
        return SampleCloud(np.full(len(points), body.face_names[0], dtype=object), points, -normals, cKDTree(points))


def mesh_of(problem: GraspProblem) -> Mesh:
    """Return a problem's body, which must be a mesh."""
    if not isinstance(problem.body, Mesh):
        raise InputError("GraspProblem.body", type(problem.body).__name__, "a mesh")
    return problem.body


def is_usable(problem: GraspProblem, points: FloatArray, outward: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of mesh points (m, 3), with outward normals (m, 3), that a contact may use.

    They are the margin away from sharp edges, the normals there are near those of the smooth surface, and the largest
    fingertip that is where its contact is cuts the mesh nowhere.
    """
    body, face, hand = mesh_of(problem), problem.body.face_names[0], problem.hand
    kept = np.sum(body.evaluate(face, points)[2] * outward, axis=1) >= np.cos(MESH_ANGLE)
    if directions := _directions(problem):
        kept &= _determines_direction(directions, outward)
    if problem.margin > 0.0:
        kept &= body.edge_distance(face, points) >= problem.margin
    radius = 0.0 if hand is None or not hand.follows_contacts else max(hand.tip_radii)
    if radius > 0.0:
        kept[kept] = body.clearance((points + radius * outward)[kept]) >= FITS * radius
    return np.asarray(kept)


class SampleTables:
    """Support tables of all contacts of a problem along shared directions.

    Parameters
    ----------
    problem : GraspProblem
    clouds : sequence of k SampleCloud
        Samples of each contact.
    rows : ConstraintValues
    hand : HandPoints
    directions : (j, d) array, optional
        Each with ``phi_A = 1``; well spread for the task if not given.

    Attributes
    ----------
    budget : ForceBudget
        The problem's; the L2 budget where that depends on the hand, or the contacts' supports do not combine.
    power : float
        p of ``phi_G^p = sum_i s_i^p`` for the supports of the contacts; 1 where ``phi_G`` is the largest of them.
    combine : numpy.ufunc
        That sum, or the maximum.
    distinct : list of SampleTable
        Contacts with one model and the same samples share a table.
    of_contact : list of k int
        The table of each contact.
    directions : (j, d) array
        Each with ``phi_A = 1``: well spread for the task if not given.
    powers : list of (j, m) array
        ``s^p`` of each table along these.
    coupled : bool
        Whether constraints are left that have to be checked on all contacts together.
    """

    def __init__(
        self,
        problem: GraspProblem,
        clouds: Sequence[SampleCloud],
        rows: ConstraintValues,
        hand: HandPoints,
        directions: FloatArray | None = None,
    ) -> None:
        self.budget: ForceBudget = problem.budget if type(problem.budget) in MEASURES else L2Budget()
        measure = Measure.of(self.budget)
        self.power = measure.power if measure.exact else 1.0
        self.combine: np.ufunc = np.add if measure.exact else np.maximum
        models, origin = problem.models, problem.origin
        self._jaws = isinstance(problem.hand, ParallelJaw)
        allowed = [_satisfying_samples(rows, hand, clouds, i) for i in range(len(models))]
        keys = [(model, id(clouds[i]), allowed[i].tobytes()) for i, model in enumerate(models)]
        first = [keys.index(key) for key in keys]
        order = sorted(set(first))
        self.of_contact = [order.index(i) for i in first]
        self.distinct: list[SampleTable] = []
        for i in order:
            samples = _subset(clouds[i], allowed[i])
            maps = GraspStack(samples.points[:, None], samples.normals[:, None], [models[i]], origin).G
            self.distinct.append(SampleTable(models[i], measure, samples, np.asarray(maps)))
        on_one_contact = ~rows.dependence[:, -1] & (np.sum(rows.dependence, axis=1) <= 1)
        self.coupled = not (np.all(on_one_contact) and all(mask.any() for mask in allowed))
        if directions is None:
            grasps = self.places(self.random(SHAPED_BY, np.random.default_rng(0)))
            y = spread_directions(GraspStack(*grasps, models, origin), problem.task)
            directions = y / problem.task.support(y)[0][:, None]
        self.directions = directions
        self.powers = [table.powers(self.directions) for table in self.distinct]

    def samples(self, contact: int) -> SampleCloud:
        """Return the samples of a contact."""
        return self.distinct[self.of_contact[contact]].samples

    @cached_property
    def pairs(self) -> IntArray:
        """Pairs of opposite samples by number, (b, 2), where jaws have to face each other; else none."""
        if not (self._jaws and self.of_contact[0] == self.of_contact[1]):
            return np.zeros((0, 2), dtype=np.intp)
        pairs = opposite_pairs(self.samples(0))
        return np.concatenate([pairs, pairs[:, ::-1]])

    def random(self, count: int, rng: np.random.Generator) -> IntArray:
        """Return random tuples of samples, one a contact, by number, (count, k)."""
        if len(self.pairs):
            return self.pairs[rng.integers(len(self.pairs), size=count)]
        sizes = [len(self.samples(i).points) for i in range(len(self.of_contact))]
        return np.stack([rng.integers(size, size=count) for size in sizes], axis=1)

    def nearest(self, contacts: Sequence[FloatArray]) -> IntArray:
        """Return the tuples of samples nearest to contacts (k, space) each, (b, k)."""
        each = [[self.samples(i).tree.query(point)[1] for i, point in enumerate(points)] for points in contacts]
        return np.array(each, dtype=np.intp).reshape(len(contacts), len(self.of_contact))

    def places(self, tuples: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals of tuples of samples (b, k), (b, k, space) each."""
        clouds = [self.samples(i) for i in range(tuples.shape[1])]
        points = np.stack([cloud.points[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)
        return points, np.stack([cloud.normals[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)


@dataclass(frozen=True)
class SampleTable:
    """Samples feasible for one contact by the constraints on it alone, and its grasp maps there.

    Parameters
    ----------
    model : ContactModel
    measure : Measure
        Of the force budget.
    samples : SampleCloud
    maps : (m, d, n) array
    """

    model: ContactModel
    measure: Measure
    samples: SampleCloud
    maps: FloatArray

    def powers(self, y: FloatArray) -> FloatArray:
        """Return ``s^p``, the power of the support, at all samples along directions (j, d), (j, m)."""
        m, d, n = self.maps.shape
        work = (y @ self.maps.transpose(1, 0, 2).reshape(d, m * n)).reshape(len(y), m, n)
        found = (self.measure.powers if self.measure.exact else self.measure.support)(self.model, work)
        return np.asarray(found, dtype=np.float32)


def opposite_pairs(cloud: SampleCloud) -> NDArray[np.intp]:
    """Return pairs of opposite points by number, (b, 2): the second is where the first one's normal leads.

    A normal may lead out of the body and into it again: each point has up to three partners.

    Parameters
    ----------
    cloud : SampleCloud
        Of which at most 1200 points are paired, always the same.
    """
    some = np.random.default_rng(0).permutation(len(cloud.points))[:POINTS]
    p, n = cloud.points[some], cloud.normals[some]
    nearest = np.asarray(cloud.tree.query(p, k=2)[0])[:, 1]
    spacing = float(np.median(nearest)) * np.sqrt(len(cloud.points) / len(p))
    pairs = []
    for begin in range(0, len(p), BLOCK):
        here = slice(begin, begin + BLOCK)
        between = p[None] - p[here, None]
        along = np.einsum("ijk,ik->ij", between, n[here])
        beside = np.sqrt(np.maximum(np.sum(between**2, axis=2) - along**2, 0.0))
        good = (along > 0.0) & (beside <= ASIDE * spacing) & (n[here] @ n.T < 0.0)
        order = np.argsort(np.where(good, beside, np.inf), axis=1)[:, :PARTNERS]
        rows, columns = np.nonzero(np.take_along_axis(good, order, axis=1))
        ends = order[rows, columns]
        pairs.append(np.stack([some[here][rows], some[ends]], axis=1))
    return np.concatenate(pairs)


def _directions(problem: GraspProblem) -> list[tuple[float, ...]]:
    """Return the directions of lines and rectangles among the contacts."""
    each = (getattr(model, "direction", None) for model in problem.models) if problem.body.space == 3 else ()
    return [direction for direction in each if direction is not None]


def _determines_direction(directions: Sequence[tuple[float, ...]], outward: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of unit normals (m, 3) at which all directions determine a line's or rectangle's orientation."""
    return np.asarray(np.all([is_off_normal(direction, outward) for direction in directions], axis=0))


def _subset(cloud: SampleCloud, allowed: NDArray[np.bool_]) -> SampleCloud:
    """Return at most ``SAMPLES`` feasible points (m,) of a cloud; all are used where none is feasible."""
    kept = np.flatnonzero(allowed if allowed.any() else ~allowed)
    if len(kept) > SAMPLES:
        kept = np.random.default_rng(0).choice(kept, SAMPLES, replace=False)
    return cloud.subset(kept)


def _satisfying_samples(
    rows: ConstraintValues, hand: HandPoints, clouds: Sequence[SampleCloud], contact: int
) -> NDArray[np.bool_]:
    """Return the mask of a contact's samples that satisfy the constraints on that contact alone, (m,)."""
    cloud, count = clouds[contact], len(clouds[contact].points)
    alone = rows.dependence[:, contact] & (np.sum(rows.dependence, axis=1) == 1)
    if not alone.any():
        return np.ones(count, dtype=bool)
    points, normals = (
        np.repeat(np.stack([getattr(c, key)[0] for c in clouds])[None], count, axis=0) for key in ("points", "normals")
    )
    points[:, contact], normals[:, contact] = cloud.points, cloud.normals
    values = rows.values(points, normals, hand.start(points, normals))
    return np.asarray(np.all(rows.each_excess(values, BAND)[:, alone] <= KEEPS, axis=1))
