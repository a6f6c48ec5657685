"""Directions of wrench space in which relaxed placements are weakest, with contacts spread over their cells.

``NumberedDirections`` lists all directions of a search. New ones minimise the support ratio of the fractional
placements dual to the bounds (``FractionalContacts``), by inverse iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.global_bound.cell_supports import CombinationRule, Supports
from nlpgrasp.global_bound.contact_cells import ContactCells
from nlpgrasp.quality.ratio_minimisation import minimise_by_inverse_iteration
from nlpgrasp.tasks import Task

STEPS = 5  # steps of inverse iteration
REGULAR = 1e-6  # relative increase of the Hessian's diagonal
LEAST = 1e-2  # least weight of a contact in the quadratic model, relative to the largest
RANDOM, RECENT = 200, 60  # numbers of random directions added to the lattice, and of recent ones kept
TRIED = 300  # number of trial directions
FLAT = 1e-9  # relative to the trace of the task's second moment, added to the moment of flat tasks
FRESH = 4  # number of a node's directions per replaced direction
STARTS = 3  # number of the node's own directions among the starts of the minimisation
ALIKE = 0.999  # cosine above which directions count as equal
DIGITS, ABOVE, UNIT = 11, 5e-10, 9e-10  # significant digits of directions; excess over unit work, mean and largest


class NumberedDirections:
    """Growing list of directions y with unit support of the task, ``phi_A(y) = 1``, referred to by index.

    Parameters
    ----------
    task : Task
    size : float
        Size of the body, metres, which relates torques to forces in directions where the task is flat.
    per_node : int
        Number of directions of a node.
    """

    def __init__(self, task: Task, size: float, per_node: int) -> None:
        self.task, self.per_node = task, per_node
        self._rng = np.random.default_rng(0)
        d = task.dimension
        lattice = np.concatenate([directions(d, 2), self._rng.standard_normal((RANDOM, d))])
        space = 2 if d == 3 else 3
        unit_moment = np.diag([1.0] * space + [size**2] * (d - space))
        moment = task.second_moment()
        regularised = (
            moment
            + FLAT * unit_moment * np.trace(moment)
            + 0.05 * np.mean(np.diag(moment) / np.diag(unit_moment)) * unit_moment
        )
        normalised = normalise_twists(task, lattice @ np.linalg.inv(np.linalg.cholesky(regularised)))
        self.lattice = normalised[np.any(normalised != 0.0, axis=1)]
        self._all = np.zeros((1024, d))
        self._count = 0
        self.add(self.lattice)
        self._recent = self.lattice[:0]

    def add(self, twists: FloatArray) -> IntArray:
        """Add directions (m, d), rounded to few digits, and return their indices, (m,).

        A zero direction, along which the task does no work, is replaced by one of the lattice.
        """
        twists = _round_directions(
            self.task, np.where(np.any(twists != 0.0, axis=1, keepdims=True), twists, self.lattice[:1])
        )
        indices = np.arange(self._count, self._count + len(twists))
        while self._count + len(twists) > len(self._all):
            self._all = np.concatenate([self._all, np.zeros_like(self._all)])
        self._all[indices] = twists
        self._count += len(twists)
        return indices

    def __getitem__(self, indices: IntArray) -> FloatArray:
        return self._all[indices]

    def draw_initial(self) -> IntArray:
        """Return the indices of random lattice directions for the first linear program, (per_node,)."""
        chosen = self._rng.permutation(len(self.lattice))[: self.per_node]
        return np.resize(chosen, self.per_node)

    def trial_directions(self) -> FloatArray:
        """Return trial directions, (m, d): randomly chosen well-spread ones, and recent weak ones."""
        chosen = self._rng.permutation(len(self.lattice))[: TRIED - len(self._recent)]
        return np.concatenate([self.lattice[chosen], self._recent])

    def remember(self, twists: FloatArray) -> None:
        """Add some weak directions (m, d) to the trial directions."""
        selected = twists[self._rng.permutation(len(twists))[: RECENT // 4]]
        self._recent = np.concatenate([selected, self._recent])[:RECENT]

    def renew(
        self,
        groups: Sequence[tuple[ContactCells, slice]],
        indices: IntArray,
        weights: FloatArray,
        rows: IntArray,
        fractions: FloatArray,
    ) -> IntArray:
        """Return the nodes' direction indices, with the least useful directions replaced by new weak ones.

        The new ones are the weakest of the nodes' fractional placements.

        Parameters
        ----------
        groups : sequence of (ContactCells, slice)
            Groups of identical contacts, and their slots.
        indices, weights : (b, j) arrays
            Indices and dual weights of each node's directions.
        rows, fractions : (b, k, m) arrays
            Fractional placement: rows of each contact, and its fraction at each.
        """
        fractional = []
        for group, slots in groups:
            b, c, m = rows[:, slots].shape
            group_rows, group_fractions = rows[:, slots].reshape(b, c * m), fractions[:, slots].reshape(b, c * m)
            fractional.append(FractionalContacts.at_rows(group.supports, group_rows, group_fractions, 3 * c))
        count = indices.shape[1] // FRESH
        is_copy = _is_repeated(self[indices], -weights)
        heaviest = np.argsort(np.where(is_copy, 0.0, -weights), axis=1, kind="stable")[:, :STARTS]
        heaviest_twists = self[np.take_along_axis(indices, heaviest, axis=1)]
        midpoints = normalise_twists(self.task, heaviest_twists + np.roll(heaviest_twists, 1, axis=1))
        # where the minimisation returned copies it is stuck at nonsmooth points, so it starts between directions
        is_stuck = np.any(is_copy & (weights > 0.0), axis=1)[:, None, None]
        starts = np.where(is_stuck & np.any(midpoints != 0.0, axis=2, keepdims=True), midpoints, heaviest_twists)
        trials = self.trial_directions()
        all_trials = np.broadcast_to(trials, (len(weights), *trials.shape))
        values = sum(contacts.value(all_trials) for contacts in fractional)
        weakest = trials[np.argsort(values, axis=1, kind="stable")[:, :count]]
        minimisers, ratios = minimise_ratio(fractional, self.task, np.concatenate([starts, weakest], axis=1))
        order = np.argsort(np.where(_is_repeated(minimisers, ratios), np.inf, ratios), axis=1, kind="stable")[:, :count]
        new = np.take_along_axis(minimisers, order[..., None], axis=1)
        new_indices = self.add(new.reshape(-1, new.shape[2])).reshape(new.shape[:2])
        self.remember(new[:, 0])
        result = indices.copy()
        usefulness = np.where(is_copy, -1.0, weights)  # copies are replaced first
        np.put_along_axis(result, np.argsort(usefulness, axis=1, kind="stable")[:, :count], new_indices, axis=1)
        return result


def _is_repeated(twists: FloatArray, ratios: FloatArray) -> BoolArray:
    """Return the mask (b, m) of twists whose direction nearly equals that of a twist of smaller ratio.

    Twists are (b, m, d), their ``ratios`` (b, m). Of equal ratios, the first counts as smaller.
    """
    unit = twists / np.maximum(np.max(np.abs(twists), axis=1, keepdims=True), 1e-300)
    unit /= np.maximum(np.linalg.norm(unit, axis=2, keepdims=True), 1e-300)
    is_near = unit @ unit.transpose(0, 2, 1) > ALIKE
    rank = np.argsort(np.argsort(ratios, axis=1, kind="stable"), axis=1)
    return np.asarray(np.any(is_near & (rank[:, None] < rank[:, :, None]), axis=2))


def _round_directions(task: Task, twists: FloatArray) -> FloatArray:
    """Return directions (m, d) rounded to few digits, with a task support slightly above one.

    Bounds that assume unit work then remain valid. Directions for which this fails are not rounded.
    """
    largest = np.max(np.abs(twists), axis=1, keepdims=True)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(largest)))
    rounded = np.round(twists * (1.0 + ABOVE) * scale) / scale
    work = task.support(rounded)[0]
    return np.where(((work >= 1.0) & (work <= 1.0 + UNIT))[:, None], rounded, twists)


@dataclass(frozen=True)
class FractionalContacts:
    """Identical contacts spread over representative contacts by fractions, for a batch of nodes.

    Parameters
    ----------
    contact : ContactModel
    rule : CombinationRule
    maps : (b, m, d, n_i) array
        Grasp maps of the contact at each row.
    weights : (b, m) array
        Fractions, at least zero.
    """

    contact: ContactModel
    rule: CombinationRule
    maps: FloatArray
    weights: FloatArray

    @classmethod
    def at_rows(cls, supports: Supports, rows: IntArray, weights: FloatArray, count: int) -> FractionalContacts:
        """Return contacts spread over the ``count`` heaviest of representative contacts (b, m)."""
        if rows.shape[1] > count:
            heaviest = np.argpartition(-weights, count, axis=1)[:, :count]
            total = np.sum(weights, axis=1, keepdims=True)
            rows = np.take_along_axis(rows, heaviest, axis=1)
            weights = np.take_along_axis(weights, heaviest, axis=1)
            weights = weights * (total / np.sum(weights, axis=1, keepdims=True))
        return cls(supports.contact, supports.rule, supports.maps[rows], weights)

    def value(self, twists: FloatArray) -> FloatArray:
        """Return the weighted sum ``sum of w s^p`` along twists (b, m, d), (b, m)."""
        s = self._work(twists)[1]
        return np.asarray(np.sum(s**self.rule.search_power * self.weights[:, None], axis=2))

    def model(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``value``, (b, m), with the Hessian of a quadratic model, (b, m, d, d), along twists (b, m, d)."""
        p, maps = self.rule.search_power, self.maps
        z, s = self._work(twists)
        scaled = np.broadcast_to(self.weights[:, None], s.shape)
        if p != 2.0:  # sum of w s^(p-2) |P z|^2 / 2, as in ``quality.screening``
            relative = np.maximum(s / np.maximum(np.max(s, axis=2, keepdims=True), 1e-300), LEAST)
            scaled = scaled * relative ** (p - 2.0)
        derivative = self.contact.derivative(z) * scaled[..., None, None]
        b, m, r, n = z.shape
        d = maps.shape[2]
        left = (maps[:, None] @ derivative).transpose(0, 1, 3, 2, 4).reshape(b, m, d, r * n)
        right = maps.transpose(0, 1, 3, 2).reshape(b, 1, r * n, d)
        return np.sum(s**p * self.weights[:, None], axis=2), left @ right

    def _work(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the work along force components, (b, m, r, n), and the supports, (b, m, r), for twists (b, m, d)."""
        b, r, d, n = self.maps.shape
        z = (twists @ self.maps.transpose(0, 2, 1, 3).reshape(b, d, r * n)).reshape(b, twists.shape[1], r, n)
        return z, self.rule.support(self.contact, z)


def normalise_twists(task: Task, twists: FloatArray) -> FloatArray:
    """Return twists (..., d) scaled to unit support of the task; zero where the task does no work."""
    reach = task.support(twists.reshape(-1, twists.shape[-1]))[0].reshape(twists.shape[:-1])
    size = np.linalg.norm(twists, axis=-1)
    has_work = (reach > 1e-12 * size) & np.isfinite(size)
    return np.where(has_work[..., None], twists / np.where(has_work, reach, 1.0)[..., None], 0.0)


def minimise_ratio(
    fractional: Sequence[FractionalContacts], task: Task, twists: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Minimise ``phi_G / phi_A`` of fractional placements from twists (b, m, d), by inverse iteration.

    Returns
    -------
    twists : (b, m, d) array
        Directions of unit work.
    ratios : (b, m) array
        ``phi_G / phi_A`` there.
    """
    power = fractional[0].rule.search_power

    def model(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        parts = [contacts.model(u) for contacts in fractional]
        value, H = (np.sum([part[i] for part in parts], axis=0) for i in (0, 1))
        diagonal = np.arange(u.shape[2])
        scale = np.max(H[..., diagonal, diagonal], axis=1, keepdims=True)
        H[..., diagonal, diagonal] += REGULAR * (scale + REGULAR * np.max(scale, axis=2, keepdims=True)) + 1e-300
        reach, wrench = task.support(u.reshape(-1, u.shape[2]))
        reach = reach.reshape(u.shape[:2])
        ratio = np.maximum(value, 0.0) ** (1.0 / power) / np.where(reach > 0.0, reach, 1.0)
        return np.where(reach > 0.0, ratio, np.inf), wrench.reshape(u.shape), H

    u, value = minimise_by_inverse_iteration(model, twists, STEPS)
    return normalise_twists(task, u), value
