"""Support tables of single contacts: directions of wrench space times surface samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.global_bound.bound.measure import MEASURES, Measure
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.workbench.across import pairs_across
from nlpgrasp.optimize.workbench.hand_points import HandPoints
from nlpgrasp.optimize.workbench.row_values import RowValues
from nlpgrasp.optimize.workbench.surface_samples import Cloud
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.screening import spread_directions

IntArray = NDArray[np.intp]

SAMPLES = 2400  # samples per contact, at most
BAND = 0.05  # allowed violation of equations, relative to their scales; samples are projected afterwards
KEEPS = 1e-5  # violation, relative to the constraint's scale, that counts as none
SHAPED_BY = 256  # random grasps whose wrenches complete the metric of a degenerate task


@dataclass(frozen=True)
class SampleTable:
    """Samples feasible for one contact by the constraints on it alone, and its grasp maps there.

    Parameters
    ----------
    model : ContactModel
    measure : Measure
        Of the force budget.
    samples : Cloud
    maps : (m, d, n) array
    """

    model: ContactModel
    measure: Measure
    samples: Cloud
    maps: FloatArray

    def powers(self, y: FloatArray) -> FloatArray:
        """Return ``s^p``, the power of the support, at all samples along directions (j, d), (j, m)."""
        m, d, n = self.maps.shape
        work = (y @ self.maps.transpose(1, 0, 2).reshape(d, m * n)).reshape(len(y), m, n)
        found = (self.measure.powers if self.measure.exact else self.measure.support)(self.model, work)
        return np.asarray(found, dtype=np.float32)


class SampleTables:
    """Support tables of all contacts of a problem along shared directions.

    Parameters
    ----------
    problem : GraspProblem
    clouds : sequence of k Cloud
        Samples of each contact.
    rows : RowValues
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
        clouds: Sequence[Cloud],
        rows: RowValues,
        hand: HandPoints,
        directions: FloatArray | None = None,
    ) -> None:
        self.budget: ForceBudget = problem.budget if type(problem.budget) in MEASURES else L2Budget()
        measure = Measure.of(self.budget)
        self.power = measure.power if measure.exact else 1.0
        self.combine: np.ufunc = np.add if measure.exact else np.maximum
        models, origin = problem.models, problem.origin
        self._jaws = isinstance(problem.hand, ParallelJaw)
        allowed = [_allowed(rows, hand, clouds, i) for i in range(len(models))]
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

    def samples(self, contact: int) -> Cloud:
        """Return the samples of a contact."""
        return self.distinct[self.of_contact[contact]].samples

    @cached_property
    def pairs(self) -> IntArray:
        """Pairs of opposite samples by number, (b, 2), where jaws have to face each other; else none."""
        if not (self._jaws and self.of_contact[0] == self.of_contact[1]):
            return np.zeros((0, 2), dtype=np.intp)
        pairs = pairs_across(self.samples(0))
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


def _subset(cloud: Cloud, allowed: NDArray[np.bool_]) -> Cloud:
    """Return at most ``SAMPLES`` feasible points (m,) of a cloud; all are used where none is feasible."""
    kept = np.flatnonzero(allowed if allowed.any() else ~allowed)
    if len(kept) > SAMPLES:
        kept = np.random.default_rng(0).choice(kept, SAMPLES, replace=False)
    return cloud.subset(kept)


def _allowed(rows: RowValues, hand: HandPoints, clouds: Sequence[Cloud], contact: int) -> NDArray[np.bool_]:
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
