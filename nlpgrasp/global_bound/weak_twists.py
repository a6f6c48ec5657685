"""Directions of wrench space for dual weights: weakest of fractional placements, numbered.

``WeightedDirections`` numbers all directions of a search. New ones minimise the support ratio of the fractional
placements that bounds rest on (``FractionalContacts``), by inverse iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.global_bound.cell_supports import Measure, Supports
from nlpgrasp.global_bound.cells.cell import IntArray
from nlpgrasp.global_bound.contact_cells import ContactCells
from nlpgrasp.quality.ratio_minimisation import iterate_inverse
from nlpgrasp.tasks import Task

STEPS = 5  # of inverse iteration
REGULAR = 1e-6  # relative increase of the Hessian's diagonal
LEAST = 1e-2  # weight of a contact in the quadratic model, relative to the largest
RANDOM, RECENT = 200, 60  # random directions beside the lattice; recent ones kept
TRIED = 300  # directions along which a fractional placement is tried
FLAT = 1e-9  # share of the task's second moment that fills the directions in which a task is flat
FRESH = 4  # directions of a node that are replaced: one of so many
STARTS = 3  # of the node's own directions that descents begin from, or between, beside the weakest of those tried
ALIKE = 0.999  # cosine above which directions count as the same
DIGITS, ABOVE, UNIT = 11, 5e-10, 9e-10  # of directions; how far a unit of work is exceeded, about and at most


class WeightedDirections:
    """A growing list of directions y with unit work of the task, ``phi_A(y) = 1``.

    Parameters
    ----------
    task : Task
    size : float
        Of the body, metres: what turns torques into forces where the task does not say.
    per_node : int
        Directions of a node.
    """

    def __init__(self, task: Task, size: float, per_node: int) -> None:
        self.task, self.per_node = task, per_node
        self._rng = np.random.default_rng(0)
        d = task.dimension
        lattice = np.concatenate([directions(d, 2), self._rng.standard_normal((RANDOM, d))])
        space = 2 if d == 3 else 3
        own = np.diag([1.0] * space + [size**2] * (d - space))
        moment = task.second_moment()
        filled = moment + FLAT * own * np.trace(moment) + 0.05 * np.mean(np.diag(moment) / np.diag(own)) * own
        found = normalise_twists(task, lattice @ np.linalg.inv(np.linalg.cholesky(filled)))
        self.lattice = found[np.any(found != 0.0, axis=1)]
        self._all = np.zeros((1024, d))
        self._count = 0
        self.add(self.lattice)
        self._recent = self.lattice[:0]

    def add(self, twists: FloatArray) -> IntArray:
        """Add directions (m, d), with few digits, and return their numbers, (m,).

        In place of a zero row, along which the task does no work and every bound would be zero, stands one of the
        lattice.
        """
        twists = _short_directions(
            self.task, np.where(np.any(twists != 0.0, axis=1, keepdims=True), twists, self.lattice[:1])
        )
        numbers = np.arange(self._count, self._count + len(twists))
        while self._count + len(twists) > len(self._all):
            self._all = np.concatenate([self._all, np.zeros_like(self._all)])
        self._all[numbers] = twists
        self._count += len(twists)
        return numbers

    def __getitem__(self, numbers: IntArray) -> FloatArray:
        return self._all[numbers]

    def first(self) -> IntArray:
        """Return the directions that a search begins with, (per_node,)."""
        chosen = self._rng.permutation(len(self.lattice))[: self.per_node]
        return np.resize(chosen, self.per_node)

    def trial_directions(self) -> FloatArray:
        """Return directions along which relaxed placements may be weak: well-spread, random and recent ones."""
        chosen = self._rng.permutation(len(self.lattice))[: TRIED - len(self._recent)]
        return np.concatenate([self.lattice[chosen], self._recent])

    def remember(self, twists: FloatArray) -> None:
        """Keep some of the directions (m, d) that were found weak."""
        some = twists[self._rng.permutation(len(twists))[: RECENT // 4]]
        self._recent = np.concatenate([some, self._recent])[:RECENT]

    def renewed(
        self,
        groups: Sequence[tuple[ContactCells, slice]],
        numbers: IntArray,
        weights: FloatArray,
        rows: IntArray,
        shares: FloatArray,
    ) -> IntArray:
        """Return directions of some nodes, the least useful replaced by the weakest ones of relaxed placements.

        Parameters
        ----------
        groups : sequence of (ContactCells, slice)
            Contacts that are alike, and their slots.
        numbers, weights : (b, j) arrays
            Of each node's directions.
        rows, shares : (b, k, m) arrays
            Where each contact is spread, and how much of it is there.
        """
        designs = []
        for pieces, where in groups:
            b, c, m = rows[:, where].shape
            places, spread = rows[:, where].reshape(b, c * m), shares[:, where].reshape(b, c * m)
            designs.append(FractionalContacts.over(pieces.supports, places, spread, 3 * c))
        few = numbers.shape[1] // FRESH
        copied = _is_repeated(self[numbers], -weights)
        heavy = np.argsort(np.where(copied, 0.0, -weights), axis=1)[:, :STARTS]
        own = self[np.take_along_axis(numbers, heavy, axis=1)]
        between = normalise_twists(self.task, own + np.roll(own, 1, axis=1))  # what descents that stay at corners miss
        stuck = np.any(copied & (weights > 0.0), axis=1)[:, None, None]
        begin = np.where(stuck & np.any(between != 0.0, axis=2, keepdims=True), between, own)
        tried = self.trial_directions()
        every = np.broadcast_to(tried, (len(weights), *tried.shape))
        value = sum(d.value(every) for d in designs)
        weakest = tried[np.argsort(value, axis=1)[:, :few]]
        found, ratios = minimise_ratio(designs, self.task, np.concatenate([begin, weakest], axis=1))
        order = np.argsort(np.where(_is_repeated(found, ratios), np.inf, ratios), axis=1)[:, :few]
        fresh = np.take_along_axis(found, order[..., None], axis=1)
        added = self.add(fresh.reshape(-1, fresh.shape[2])).reshape(fresh.shape[:2])
        self.remember(fresh[:, 0])
        result = numbers.copy()
        least = np.where(copied, -1.0, weights)  # copies share the weight of one of them
        np.put_along_axis(result, np.argsort(least, axis=1)[:, :few], added, axis=1)
        return result


def _is_repeated(twists: FloatArray, ratios: FloatArray) -> NDArray[np.bool_]:
    """Return which directions (b, m, d) are nearly those of others with smaller ratios (b, m)."""
    unit = twists / np.maximum(np.max(np.abs(twists), axis=1, keepdims=True), 1e-300)
    unit /= np.maximum(np.linalg.norm(unit, axis=2, keepdims=True), 1e-300)
    near = unit @ unit.transpose(0, 2, 1) > ALIKE
    first = np.argsort(np.argsort(ratios, axis=1), axis=1)
    return np.asarray(np.any(near & (first[:, None] < first[:, :, None]), axis=2))


def _short_directions(task: Task, twists: FloatArray) -> FloatArray:
    """Return directions (m, d) with few digits along which the task does hardly more than unit work, and no less.

    Bounds that take the work for 1 are then no lower than they should be. One that would have to be off by more stays.
    """
    largest = np.max(np.abs(twists), axis=1, keepdims=True)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(largest)))
    short = np.round(twists * (1.0 + ABOVE) * scale) / scale
    work = task.support(short)[0]
    return np.where(((work >= 1.0) & (work <= 1.0 + UNIT))[:, None], short, twists)


@dataclass(frozen=True)
class FractionalContacts:
    """Fractional placement of identical contacts over rows, for a batch of nodes.

    Parameters
    ----------
    contact : ContactModel
    measure : Measure
    maps : (b, m, d, n_i) array
        Grasp maps of the contact at each place.
    weights : (b, m) array
        At least zero.
    """

    contact: ContactModel
    measure: Measure
    maps: FloatArray
    weights: FloatArray

    @classmethod
    def over(cls, supports: Supports, rows: IntArray, weights: FloatArray, most: int) -> FractionalContacts:
        """Return the fractional placements of a batch over rows (b, m), of the heaviest alone where there are many."""
        if rows.shape[1] > most:
            heavy = np.argpartition(-weights, most, axis=1)[:, :most]
            total = np.sum(weights, axis=1, keepdims=True)
            rows = np.take_along_axis(rows, heavy, axis=1)
            weights = np.take_along_axis(weights, heavy, axis=1)
            weights = weights * (total / np.sum(weights, axis=1, keepdims=True))
        return cls(supports.contact, supports.measure, supports.maps[rows], weights)

    def value(self, twists: FloatArray) -> FloatArray:
        """Return ``sum of w s^p`` along twists (b, m, d), (b, m)."""
        s = self.supports(twists)
        return np.asarray(np.sum(s**self.measure.power * self.weights[:, None], axis=2))

    def supports(self, twists: FloatArray) -> FloatArray:
        """Return the support of each contact along twists (b, m, d), (b, m, r)."""
        return self._work(twists)[1]

    def model(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the value, (b, m), and the Hessian of a quadratic model of it, (b, m, d, d)."""
        p, maps = self.measure.power, self.maps
        z, s = self._work(twists)
        shares = np.broadcast_to(self.weights[:, None], s.shape)
        if p != 2.0:  # sum of w s^(p-2) |P z|^2 / 2, as in ``quality.screening``
            relative = np.maximum(s / np.maximum(np.max(s, axis=2, keepdims=True), 1e-300), LEAST)
            shares = shares * relative ** (p - 2.0)
        bent = self.contact.derivative(z) * shares[..., None, None]
        b, m, r, n = z.shape
        d = maps.shape[2]
        left = (maps[:, None] @ bent).transpose(0, 1, 3, 2, 4).reshape(b, m, d, r * n)
        right = maps.transpose(0, 1, 3, 2).reshape(b, 1, r * n, d)
        return np.sum(s**p * self.weights[:, None], axis=2), left @ right

    def _work(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return force components (b, m, r, n) and supports (b, m, r)."""
        b, r, d, n = self.maps.shape
        z = (twists @ self.maps.transpose(0, 2, 1, 3).reshape(b, d, r * n)).reshape(b, twists.shape[1], r, n)
        return z, self.measure.support(self.contact, z)


def normalise_twists(task: Task, twists: FloatArray) -> FloatArray:
    """Return twists (..., d) scaled so that the task does unit work along them; zero where it does none."""
    reach = task.support(twists.reshape(-1, twists.shape[-1]))[0].reshape(twists.shape[:-1])
    size = np.linalg.norm(twists, axis=-1)
    does = (reach > 1e-12 * size) & np.isfinite(size)
    return np.where(does[..., None], twists / np.where(does, reach, 1.0)[..., None], 0.0)


def minimise_ratio(
    designs: Sequence[FractionalContacts], task: Task, twists: FloatArray, steps: int = STEPS
) -> tuple[FloatArray, FloatArray]:
    """Minimise ``phi_G / phi_A`` of fractional placements from twists (b, m, d), by inverse iteration.

    Returns
    -------
    twists : (b, m, d) array
        Along which the task does unit work.
    ratios : (b, m) array
        ``phi_G / phi_A`` there.
    """
    power = designs[0].measure.power

    def model(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        parts = [design.model(u) for design in designs]
        value, H = (np.sum([part[i] for part in parts], axis=0) for i in (0, 1))
        diagonal = np.arange(u.shape[2])
        scale = np.max(H[..., diagonal, diagonal], axis=1, keepdims=True)
        H[..., diagonal, diagonal] += REGULAR * (scale + REGULAR * np.max(scale, axis=2, keepdims=True)) + 1e-300
        reach, wrench = task.support(u.reshape(-1, u.shape[2]))
        reach = reach.reshape(u.shape[:2])
        ratio = np.maximum(value, 0.0) ** (1.0 / power) / np.where(reach > 0.0, reach, 1.0)
        return np.where(reach > 0.0, ratio, np.inf), wrench.reshape(u.shape), H

    u, value = iterate_inverse(model, twists, steps)
    return normalise_twists(task, u), value
