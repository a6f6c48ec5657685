"""Fast upper bounds on mu for many grasps: sampled support ratios, and local minimisation from the least.

All work on stacks of grasps at once. ``screen`` is the complete bound; the other functions are its parts, for searches
that choose the directions themselves.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from nlpgrasp.budgets import ForceBudget, force_budget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.unit_directions import directions, directions_around
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.contacts.base import upper_triangle
from nlpgrasp.contacts.product import derivative_entries, project
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import task_for
from nlpgrasp.quality.force_closure import normals_to_pairs, planar_facets, turned_to_task
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.ratio_minimisation import minimise_by_inverse_iteration, regularisation
from nlpgrasp.tasks import Task

CHUNK = 256  # grasps per batch, to fit the processor's cache
DESCENTS, STEPS = 4, 16  # descents per grasp, and their steps
FLAT = 1e-6  # least over largest moment of the task, relative to the grasps', below which it counts as flat
PLANAR = 200  # directions for planar grasps
LEAST_WEIGHT = 1e-2  # least relative weight of a contact in the quadratic model


def screen(stack: GraspStack, task: Task, *, force_budget: str | ForceBudget = "l2") -> FloatArray:
    """Return an upper bound on each grasp's mu, for ranking thousands of grasps.

    With the L2 budget it is mostly mu itself, and in the plane with limits on normal forces as well, where the wrench
    set has facets; in space some 5 % above on average with the other budgets, and far above for some grasps that barely
    exert the task. The ratio ``phi_G / phi_A`` is evaluated in well-spread directions, and minimised locally from the
    weakest; in the plane also beside the normals of the cone of all wrenches, where descents miss that a task leaves
    it. A value of 0 proves that a grasp cannot exert the task; any other value proves nothing.

    Parameters
    ----------
    stack : GraspStack
        Grasps to compare.
    task : Task
        Wrenches that the fingers are to exert, as for ``mu``.
    force_budget : str or ForceBudget
        Bound on the finger forces.

    Returns
    -------
    (b,) array
        At least mu of each grasp, in the unit of ``mu``.
    """
    if not isinstance(stack, GraspStack):
        raise InputError("stack", stack, "a GraspStack")
    task = task_for(task, stack)
    force_set = fixed_force_set(stack, _budget(stack, force_budget))
    if not len(stack):
        return np.zeros(0)
    if stack.dimension > 3:
        return least_ratios(stack, task, force_set)
    least, lack = planar_ratios(stack, task, force_set)
    return np.where(lack > 0.0, 0.0, least)


def least_ratios(stack: GraspStack, task: Task, force_set: ForceSet) -> FloatArray:
    """Return the least ratios ``phi_G / phi_A`` that descents from well-spread directions find, (b,)."""
    y = spread_directions(stack, task)
    bounds = [_descend(GraspBatch(stack.G[a : a + CHUNK], force_set), task, y) for a in range(0, len(stack), CHUNK)]
    return np.concatenate(bounds)


def planar_ratios(stack: GraspStack, task: Task, force_set: ForceSet) -> tuple[FloatArray, FloatArray]:
    """Return the least ratios found of planar grasps, and the share of the task outside their cones of wrenches.

    Both are (b,). The share is that of the support along a facet's normal of the cone, 0 where the task is inside;
    where it is not, the ratios are about what mu would be if it were. A wrench set with finitely many facets, each
    through two of its edges, has its least ratio, which is mu, along one of their normals. Others have narrow minima
    beside those of the cone, which descents miss.
    """
    normals, is_facet = planar_facets(stack.G, stack.contacts)
    moment = second_moment(stack, task)
    reach = task.support(normals.reshape(-1, 3))[0].reshape(is_facet.shape)
    size = np.sqrt(np.einsum("bmi,ij,bmj->bm", normals, moment, normals))
    shares = np.max(np.where(is_facet, reach / np.maximum(size, 1e-300), 0.0), axis=1, initial=0.0)
    lack, edges = np.where(shares > 1e-9, shares, 0.0), force_set.edges
    if edges is not None:
        normals, lengths = normals_to_pairs(edges @ stack.G.transpose(0, 2, 1))
        chosen = lengths > 1e-12 * np.max(lengths, axis=1)[:, None]
        return _least_along(stack, task, force_set, normals, chosen, lack > 0.0), lack
    least = least_ratios(stack, task, force_set)
    beside = [
        _least_along(stack, task, force_set, turned, is_facet)
        for turned in turned_to_task(normals, task, moment, (1.02, 1.1, 1.5, 3.0))
    ]
    return np.where(lack > 0.0, least, np.minimum(least, np.min(beside, axis=0))), lack


def _least_along(
    stack: GraspStack,
    task: Task,
    force_set: ForceSet,
    y: FloatArray,
    chosen: BoolArray,
    is_outside: BoolArray | None = None,
) -> FloatArray:
    """Return the least ratio (b,) along chosen ones, (b, m), of directions y (b, m, 3) along which the task pushes.

    Of grasps whose cone of wrenches the task leaves, mask (b,), along those in which contacts push as well.
    """
    reach = task.support(y.reshape(-1, 3))[0].reshape(chosen.shape)
    is_asked = chosen & (reach > 1e-12)
    ratios = GraspBatch(stack.G, force_set).support(y) / np.where(is_asked, reach, 1.0)
    if is_outside is not None:
        is_asked &= (ratios > 1e-9 * np.max(ratios, axis=1)[:, None]) | ~is_outside[:, None]
    return np.asarray(np.min(ratios, axis=1, initial=np.inf, where=is_asked))


def _budget(stack: GraspStack, value: str | ForceBudget) -> ForceBudget:
    """Return the force budget for the stack's contacts; raise if it depends on their frames."""
    budget = force_budget(value)
    budget.check(stack.contacts, stack.space)
    if budget.depends_on_frames:
        raise InputError("force_budget", value, "a budget that does not depend on each grasp's frames")
    return budget


def _descend(view: GraspBatch, task: Task, y: FloatArray) -> FloatArray:
    """Return the least support ratio of each grasp over directions and local descents from the weakest, (b,)."""
    ratios = view.support(np.broadcast_to(y, (len(view.G), *y.shape))) / task.support(y)[0]
    least_sampled = ratios.min(axis=1)
    weakest = np.argpartition(ratios, min(DESCENTS, ratios.shape[1]) - 1, axis=1)[:, :DESCENTS]
    value = minimise_by_inverse_iteration(lambda u: view.quadratic(u, task), y[weakest], STEPS)[1]
    return np.asarray(np.minimum(least_sampled, value.min(axis=1)))


def spread_directions(stack: GraspStack, task: Task) -> FloatArray:
    """Return directions (m, d) that are well spread in the task's metric.

    The metric is regularised by the grasps' where the task is flat.
    """
    planar = stack.dimension == 3
    spread = directions_around(np.eye(3)[0], PLANAR) if planar else directions(stack.dimension, 2)
    y = spread @ np.linalg.inv(np.linalg.cholesky(second_moment(stack, task)))
    reach = task.support(y)[0]
    return np.asarray(y[reach > 1e-9 * np.max(reach)])


def second_moment(stack: GraspStack, task: Task) -> FloatArray:
    """Return the task's second moment (d, d), regularised by the grasps' if the task is flat."""
    G = stack.G[:CHUNK]
    grasp_moment = np.mean(G @ G.transpose(0, 2, 1), axis=0)
    grasp_moment += 1e-9 * np.diag(np.diag(grasp_moment)) + 1e-12 * np.trace(grasp_moment) * np.eye(len(grasp_moment))
    moment = task.second_moment()
    relative = eigh(moment, grasp_moment, eigvals_only=True)
    if relative[0] <= FLAT * relative[-1]:
        moment = moment + 0.1 * float(np.mean(relative)) * grasp_moment
    return np.asarray(moment)


def sampled_ratios(stack: GraspStack, task: Task, y: FloatArray, budget: ForceBudget) -> FloatArray:
    """Return the ratios ``phi_G(y_j) / phi_A(y_j)`` of each grasp and direction, all upper bounds on mu.

    Parameters
    ----------
    stack : GraspStack
    task : Task
    y : (m, d) array
        Directions; those with ``phi_A <= 0`` are left out.
    budget : ForceBudget
        One that does not depend on the contacts' frames.

    Returns
    -------
    (b, m') array
        One row per grasp, one column per kept direction.
    """
    reach = task.support(y)[0]
    y, reach = y[reach > 0.0], reach[reach > 0.0]
    return np.asarray(sampled_supports(stack, y, budget) / reach)


def sampled_supports(stack: GraspStack, y: FloatArray, budget: ForceBudget) -> FloatArray:
    """Return the supports (b, m) of each grasp along directions (m, d), under a budget as of ``sampled_ratios``."""
    view = GraspBatch(stack.G, fixed_force_set(stack, budget))
    return view.support(np.broadcast_to(y, (len(stack), *y.shape)))


def screening_score(ratios: FloatArray) -> FloatArray:
    """Return scores (b,) for ranking grasps from their support ratios (b, m).

    The least ratio, plus a small share of the lowest tenth's mean to break ties at 0.
    """
    count = max(1, ratios.shape[1] // 10)
    lowest = np.partition(ratios, count - 1, axis=1)[:, :count]
    return np.asarray(lowest.min(axis=1) + 0.05 * lowest.mean(axis=1))


def minimise_locally(
    stack: GraspStack, task: Task, y: FloatArray, budget: ForceBudget, steps: int = STEPS
) -> tuple[FloatArray, FloatArray]:
    """Minimise ``phi_G / phi_A`` locally from directions of each grasp, (b, m, d).

    Parameters
    ----------
    stack : GraspStack
    task : Task
    y : (b, m, d) array
    budget : ForceBudget
        One that does not depend on the contacts' frames.
    steps : int

    Returns
    -------
    directions : (b, m, d) array
    ratios : (b, m) array
    """
    view = GraspBatch(stack.G, fixed_force_set(stack, budget))
    return minimise_by_inverse_iteration(lambda u: view.quadratic(u, task), y, steps)


class GraspBatch:
    """Batched support functions of grasps with maps G (b, d, n) and one force set."""

    def __init__(self, G: FloatArray, force_set: ForceSet) -> None:
        self.G = G
        self._set = force_set

    @cached_property
    def _regularisation(self) -> FloatArray:
        return regularisation(self.G)[:, None]

    @cached_property
    def _products(self) -> FloatArray:
        """Derivatives (b, entries, d d) of ``G D G^T`` by the entries of D's symmetric blocks, one for each contact."""
        pairs = [(r.start + i, r.start + j) for r in self._set.ranges for i, j in upper_triangle(r.stop - r.start)]
        first, second = np.array(pairs).T
        columns = self.G.transpose(0, 2, 1)
        products = columns[:, first, :, None] * columns[:, second, None, :]
        products += (first != second)[:, None, None] * products.transpose(0, 1, 3, 2)
        return products.reshape(len(self.G), len(pairs), -1)

    def of(self, rows: BoolArray) -> GraspBatch:
        """Return the batch of the grasps in a mask."""
        return GraspBatch(self.G[rows], self._set)

    def support(self, y: FloatArray) -> FloatArray:
        """Return the support function (b, m) for directions of each grasp (b, m, d)."""
        z = y @ self.G
        return np.asarray(self._set.support(z.reshape(-1, z.shape[2]))[0].reshape(z.shape[:2]))

    def variables(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (b, m), and variables (b, m, l) of maximising forces, along y (b, m, d)."""
        z = y @ self.G
        phi, u = self._set.variables(z.reshape(-1, z.shape[2]))
        return phi.reshape(z.shape[:2]), u.reshape(*z.shape[:2], u.shape[1])

    def exert(self, u: FloatArray) -> FloatArray:
        """Return the wrenches (b, m, d) of forces, given their variables (b, m, l)."""
        return np.asarray(u @ (self.G @ self._set.lift).transpose(0, 2, 1))

    def positive_share(self, y: FloatArray) -> FloatArray:
        """Return ``force_closure.positive_share`` of each grasp, (b, m), for y (b, m, d)."""
        z = y @ self.G
        x = project(z.reshape(-1, z.shape[2]), self._set.contacts, self._set.space).reshape(z.shape)
        return np.asarray(np.linalg.norm(x, axis=2) / np.maximum(np.linalg.norm(z, axis=2), 1e-300))

    def quadratic(self, y: FloatArray, task: Task) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ``phi / phi_A``, the task's maximisers and the Hessian of a quadratic model of ``phi^2 / 2``.

        (b, m, d) to (b, m), (b, m, d) and (b, m, d, d). With ``phi = (sum_i phi_i^p)^(1/p)`` over the contacts the
        model is ``sum_i phi_i^(p-2) |P_Ki(z_i)|^2 / 2``: exact for the L2 budget, p = 2.
        """
        z = y @ self.G
        flat = z.reshape(-1, z.shape[2])
        phi = self._set.support(flat)[0].reshape(y.shape[:2])
        entries = derivative_entries(flat, self._set.contacts, self._set.space)
        if self._set.power != 2.0:
            x = project(flat, self._set.contacts, self._set.space)
            sizes = np.stack([np.linalg.norm(x[:, r], axis=1) for r in self._set.ranges], axis=1)
            sizes = np.maximum(sizes / np.maximum(np.max(sizes, axis=1, keepdims=True), 1e-300), LEAST_WEIGHT)
            counts = [len(upper_triangle(r.stop - r.start)) for r in self._set.ranges]
            entries = entries * np.repeat(sizes ** (self._set.power - 2.0), counts, axis=1)
        H = (entries.reshape(*y.shape[:2], -1) @ self._products).reshape(*y.shape, y.shape[2])
        reach, wrench = task.support(y.reshape(-1, y.shape[2]))
        reach = reach.reshape(y.shape[:2])
        value = np.where(reach > 0.0, phi / np.where(reach > 0.0, reach, 1.0), np.inf)
        return value, wrench.reshape(y.shape), H + self._regularisation


def fixed_force_set(stack: GraspStack, budget: ForceBudget) -> ForceSet:
    """Return the force set of a budget that does not depend on the grasps' frames."""
    frames = np.broadcast_to(np.eye(stack.space), (len(stack.contacts), stack.space, stack.space))
    return budget.at(frames, stack.contacts)
