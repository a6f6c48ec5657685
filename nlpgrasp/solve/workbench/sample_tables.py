"""Tables of the support of single contacts: surface samples times directions of wrench space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.measure import MEASURES, Measure
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.screening import spread_directions
from nlpgrasp.solve.workbench.hand_points import HandPoints
from nlpgrasp.solve.workbench.row_values import RowValues
from nlpgrasp.solve.workbench.surface_samples import Cloud, SurfaceSamples

SAMPLES = 2400  # of a contact, at most
BAND = 0.05  # of a narrow row's scale: how far from it samples may be, which are moved onto it afterwards
FEASIBLE = 1e-5  # violation of a row, relative to its scale, that counts as none
SHAPED_BY = 256  # random grasps that tell how wrenches of grasps are spread
IntArray = NDArray[np.intp]


@dataclass(frozen=True)
class SampleTable:
    """Samples that a contact may use by the constraints on it alone, and its grasp maps there.

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
        """Return the contact's support to the measure's power at all samples along directions (j, d), (j, m)."""
        m, d, n = self.maps.shape
        work = (y @ self.maps.transpose(1, 0, 2).reshape(d, m * n)).reshape(len(y), m, n)
        return np.asarray(self.measure.powers(self.model, work), dtype=np.float32)


class SampleTables:
    """Sample tables of a problem's contacts along well-spread directions of its task.

    Parameters
    ----------
    problem : GraspProblem
    surface : SurfaceSamples
    rows : RowValues
    hand : HandPoints

    Attributes
    ----------
    budget : ForceBudget
        The problem's; the L2 budget where supports of its contacts do not combine to that of a grasp.
    measure : Measure
        Of that budget.
    distinct : list of SampleTable
        Contacts with one model and the same samples share a table.
    of_contact : list of k int
        The table of each contact.
    directions : (j, d) array
        Each with ``phi_A = 1``.
    powers : list of (j, m) array
        Of each table along these.
    coupled : bool
        Whether constraints are left that have to be checked on all contacts together.
    """

    def __init__(self, problem: GraspProblem, surface: SurfaceSamples, rows: RowValues, hand: HandPoints) -> None:
        self.budget: ForceBudget = problem.budget if type(problem.budget) in MEASURES else L2Budget()
        self.measure = Measure.of(self.budget)
        models, origin = problem.models, problem.origin
        clouds = [surface.cloud(i) for i in range(len(models))]
        kept = [_allowed(rows, hand, clouds, i) for i in range(len(models))]
        keys = [(model, surface.usable(i), kept[i].tobytes()) for i, model in enumerate(models)]
        first = [keys.index(key) for key in keys]
        order = sorted(set(first))
        self.of_contact = [order.index(i) for i in first]
        self.distinct = []
        for i in order:
            samples = _subset(clouds[i], np.flatnonzero(kept[i]) if kept[i].any() else np.arange(len(kept[i])))
            maps = GraspStack(samples.points[:, None], samples.normals[:, None], [models[i]], origin).G
            self.distinct.append(SampleTable(models[i], self.measure, samples, np.asarray(maps)))
        single = np.sum(rows.dependence[:, :-1], axis=1) + rows.dependence[:, -1] * len(models) <= 1
        self.coupled = not (np.all(single) and all(mask.any() for mask in kept))
        rng = np.random.default_rng(0)
        drawn = np.stack([rng.integers(len(self.samples(i).points), size=SHAPED_BY) for i in range(len(models))], axis=1)
        y = spread_directions(GraspStack(*self.places(drawn), models, origin), problem.task)
        self.directions = y / problem.task.support(y)[0][:, None]
        self.learned = False
        self.powers = [table.powers(self.directions) for table in self.distinct]

    def samples(self, contact: int) -> Cloud:
        """Return the samples of a contact."""
        return self.distinct[self.of_contact[contact]].samples

    def places(self, tuples: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals of tuples of samples (b, k), (b, k, space) each."""
        clouds = [self.samples(i) for i in range(tuples.shape[1])]
        points = np.stack([cloud.points[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)
        return points, np.stack([cloud.normals[tuples[:, i]] for i, cloud in enumerate(clouds)], axis=1)


def _subset(cloud: Cloud, kept: IntArray) -> Cloud:
    """Return the points of a cloud with these numbers (m,), at most ``SAMPLES`` of them."""
    if len(kept) > SAMPLES:
        kept = np.random.default_rng(0).choice(kept, SAMPLES, replace=False)
    return cloud.subset(kept)


def _allowed(rows: RowValues, hand: HandPoints, clouds: list[Cloud], contact: int) -> NDArray[np.bool_]:
    """Return which samples of a contact keep the constraints on that contact alone, (m,)."""
    cloud, count = clouds[contact], len(clouds[contact].points)
    alone = rows.dependence[:, contact] & (np.sum(rows.dependence, axis=1) == 1)
    if not alone.any():
        return np.ones(count, dtype=bool)
    points, normals = (
        np.repeat(np.stack([getattr(c, key)[0] for c in clouds])[None], count, axis=0) for key in ("points", "normals")
    )
    points[:, contact], normals[:, contact] = cloud.points, cloud.normals
    values = rows.values(points, normals, hand.start(points, normals))
    return np.all(rows.each_excess(values, BAND)[:, alone] <= FEASIBLE, axis=1)
