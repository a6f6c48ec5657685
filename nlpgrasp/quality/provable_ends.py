"""Ends of an interval of mu that hold in real arithmetic for contacts, task and budget as given, in binary numbers.

A computed sum of m products is off by at most ``m eps`` times the sum of their sizes (Higham 2002, Section 3.1,
doi:10.1137/1.9780898718027): every error below is so bounded, eightfold, which also covers the grasp map's own.
The force domain is stated once, as second-order cones of variables u: ``x = A u`` with every ``M (u, 1)`` in a
second-order cone, which is how contacts and budgets state themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.quadratic_program import cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.errors import InputError
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import parts_of

OWN_SUPPORT = "a task's own support function"
EPS = float(np.finfo(float).eps)
LOSS = 8.0 * EPS  # relative rounding error that is counted for each operation


@dataclass(frozen=True)
class ForceCones:
    """Force domain ``B ∩ K`` as second-order cones of variables: ``x = A u``, every ``M (u, 1)`` in such a cone.

    Parameters
    ----------
    lift : (n, l) array
        A.
    cones : tuple of (r, l + 1) arrays
        M.
    """

    lift: FloatArray
    cones: tuple[FloatArray, ...]

    @classmethod
    def of(cls, wrenches: WrenchSet) -> ForceCones:
        """Return the cones of a wrench set's contacts and budget."""
        lift, own = wrenches.force_set.conic
        budget = [np.concatenate([M[:, :-1] @ lift, M[:, -1:]], axis=1) for M in wrenches.force_set.cones()]
        return cls(lift, (*[np.concatenate([M, np.zeros((len(M), 1))], axis=1) for M in own], *budget))

    def missing(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return by how much variables (v, l) are outside their contacts' cones, and the budget's, (v,) each.

        The first is the step along ``inward`` that leads inside, the second the share of u beyond the budget. Rounding
        errors of intervals in a row of m terms, at most ``4 (m + 1) eps sum |M_ij u_j|``, count as outside.
        """
        full = np.concatenate([u, np.ones((len(u), 1))], axis=1)
        outside = np.zeros((2, len(u)))
        for M in self.cones:
            value, error = full @ M.T, 4.0 * (M.shape[1] + 1) * EPS * (np.abs(full) @ np.abs(M).T)
            tail = np.linalg.norm(np.abs(value[:, 1:]) + error[:, 1:], axis=1) * (1.0 + 16.0 * len(M) * EPS)
            across = M[:, :-1] @ self.inward
            is_of_budget = bool(np.any(M[:, -1] != 0.0))
            gain = M[0, -1] if is_of_budget else across[0] - float(np.linalg.norm(across[1:]))
            if gain > 0.0:
                row = outside[int(is_of_budget)]
                np.maximum(row, (tail - (value[:, 0] - error[:, 0])) / gain, out=row)
        return outside[0], outside[1]

    @cached_property
    def inward(self) -> FloatArray:
        """Direction (l,) into the contacts' cones: the sum of their axes, along which pressing contacts' are wide."""
        axes = [M[0, :-1] / np.linalg.norm(M[0, :-1]) for M in self.cones if M[0, -1] == 0.0 and np.any(M[0, :-1])]
        return np.asarray(np.sum(axes, axis=0)) if axes else np.zeros(self.lift.shape[1])

    @cached_property
    def pivots(self) -> tuple[tuple[int, int], ...]:
        """Row of the stacked cones for each variable, in an order in which they determine each other.

        A row of one variable determines its multiplier last; before, variables without one take a row in which all
        others have one. Rows of the budget's cones are freest, then half-spaces, then other rows, the cones' axes last.
        """
        rows = np.concatenate(self.cones)[:, :-1] != 0.0
        rank = np.concatenate(
            [
                np.r_[4.0 if M[0, -1] else 3.0 - 2.0 * (len(M) == 1), np.full(len(M) - 1, 0.0 if M[0, -1] else 2.0)]
                for M in self.cones
            ]
        )
        of_one = np.sum(rows, axis=1) == 1
        is_later = np.any(rows[of_one], axis=0)
        of_early = np.sum(rows[:, ~is_later], axis=1)
        pivots = []
        for variable in [*np.flatnonzero(~is_later), *np.flatnonzero(is_later)]:
            is_free = of_one if is_later[variable] else of_early == 1
            options = np.flatnonzero(rows[:, variable] & is_free)
            if not len(options):
                raise InputError("force_budget", "cones without pivots", "cones in which each variable has a row")
            pivots.append((int(options[np.argmin(rank[options])]), int(variable)))
        return tuple(pivots)

    def into(self, u: FloatArray) -> FloatArray:
        """Return variables (v, l) next to ``u`` that are inside all cones in spite of rounding."""
        for _ in range(4):
            cones, budget = self.missing(u)
            if np.all(cones <= 0.0) and np.all(budget <= 0.0):
                break
            u = (u + 2.0 * cones[:, None] * self.inward) * (1.0 - 2.0 * budget)[:, None]
        return u


@dataclass(frozen=True)
class UpperProof:
    """Proof of an upper bound: multipliers of the force domain's cones along one direction.

    Parameters
    ----------
    direction : (d,) array
        Direction y of wrench space.
    multipliers : (r,) array
        s, one a row of the stacked cones; those of pivot rows are recomputed by the checker.
    pivots : tuple of (int, int)
        Row and variable, in the order in which ``b + M^T s = 0`` gives the rows' multipliers.
    """

    direction: FloatArray
    multipliers: FloatArray
    pivots: tuple[tuple[int, int], ...]


def provable_upper(wrenches: WrenchSet, domain: ForceCones, y: FloatArray, task: Task) -> tuple[float, UpperProof]:
    """Return an upper bound on mu along a direction (d,), and its proof by weak duality; infinite if none is found.

    With s in the dual of the cones and ``b + M^T s = 0``, ``b = A^T G^T y``: ``phi_W(y) <= <s, constants>``. A conic
    program finds s; the equations hold exactly when pivot rows are computed from the others. Where s is then outside a
    cone by rounding, multipliers that are well inside all of them and fulfil the equations with b = 0 are added.
    """
    M = np.concatenate(domain.cones)
    rows, constants, terms = M[:, :-1], M[:, -1], LOSS * (M.shape[1] + len(M))
    b = domain.lift.T @ (wrenches.G.T @ y)
    error_of_b = LOSS * (sum(wrenches.G.shape) + len(b)) * (np.abs(domain.lift).T @ (wrenches.sizes.T @ np.abs(y)))
    size = max(float(np.max(np.abs(b))), 1e-300)
    no_squares, left = sparse.csc_matrix((rows.shape[1],) * 2), sparse.csc_matrix(-rows)
    cones, settings = [cone_of(cone) for cone in domain.cones], quiet_settings(1e-11, 0.99)

    def dual(cost: FloatArray) -> FloatArray:
        program = clarabel.DefaultSolver(no_squares, cost, left, constants, cones, settings)
        return np.array(program.solve().z)

    s, error, inward = dual(-b / size) * size, np.zeros(len(M)), None
    ends = np.cumsum([len(cone) for cone in domain.cones])
    starts = ends - [len(cone) for cone in domain.cones]
    is_constant = ~np.any(rows[starts], axis=1)  # cones whose axes are in no equation
    upper = np.inf
    for attempt in range(8):
        for r, v in domain.pivots:
            column = rows[:, v].copy()
            column[r] = 0.0
            s[r] = -(b[v] + column @ s) / rows[r, v]
            error[r] = (error_of_b[v] + np.abs(column) @ (error + terms * np.abs(s))) / abs(rows[r, v])
            error[r] += terms * abs(s[r])
        tails = (np.abs(s[a + 1 : e]) + error[a + 1 : e] for a, e in zip(starts, ends, strict=True))
        least = np.array([np.linalg.norm(tail) * (1.0 + terms) for tail in tails]) + error[starts]
        s[starts[is_constant]] = least[is_constant] * (1.0 + terms)
        missing = least - s[starts]
        if np.all(missing <= 0.0):
            reach = float(task.support(y[None])[0][0])
            reach -= LOSS * 4 * len(y) * float(_reach_of_sizes(task, np.abs(y[None]))[0])
            largest = float(constants @ s + np.abs(constants) @ (error + terms * np.abs(s)))
            upper = largest / reach * (1.0 + LOSS) if reach > 0.0 else np.inf
            break
        if inward is None:
            axes = np.zeros(len(M))
            axes[starts] = 1.0
            inward = dual(-rows.T @ axes) + axes
        s += 4.0**attempt * float(np.max(missing)) * inward
    return upper, UpperProof(y, s, domain.pivots)


def provable_zero(wrenches: WrenchSet, domain: ForceCones, y: FloatArray, task: Task) -> tuple[float, UpperProof]:
    """Return 0 as an upper bound on mu, and its proof; infinite if none is found.

    No force does positive work along a direction of the task: multipliers of the contacts' cones, whose constants are
    0, prove it without the budget. The direction is that of the conic program ``max t: b + M^T s = 0``, every s by t
    inside its cone, ``<w, y> = 1`` for the wrench w of the task that is farthest along the given direction (d,).
    """
    own = ForceCones(domain.lift, tuple(M for M in domain.cones if M[0, -1] == 0.0))
    rows = np.concatenate([np.zeros((0, domain.lift.shape[1] + 1)), *own.cones])[:, :-1]
    if not np.all(np.any(rows, axis=0)):  # forces of either sign
        return np.inf, UpperProof(y, np.zeros(0), ())
    size = np.sqrt(np.sum(wrenches.G**2, axis=1) + np.diag(task.second_moment()))
    unit = 1.0 / np.where(size > 0.0, size, 1.0)
    (d, _), (m, count) = wrenches.G.shape, rows.shape
    axes = np.zeros((m, 1))
    axes[np.cumsum([0, *map(len, own.cones[:-1])])] = 1.0
    wrench = task.support(y[None])[1]
    equations = np.block(
        [
            [domain.lift.T @ wrenches.G.T * unit, rows.T, np.zeros((count, 1))],
            [wrench * unit, np.zeros((1, m + 1))],
            [np.zeros((1, d + m)), np.ones((1, 1))],
            [np.zeros((m, d)), -np.eye(m), axes],
        ]
    )
    program = clarabel.DefaultSolver(
        sparse.csc_matrix((d + m + 1,) * 2), np.r_[np.zeros(d + m), -1.0], sparse.csc_matrix(equations),
        np.r_[np.zeros(count), 1.0, 1.0, np.zeros(m)],
        [clarabel.ZeroConeT(count + 1), clarabel.NonnegativeConeT(1), *map(cone_of, own.cones)], quiet_settings(1e-9),
    )  # fmt: skip
    y = unit * np.array(program.solve().x)[:d]
    upper, above = provable_upper(wrenches, own, y, task)
    zeros = np.zeros(sum(map(len, domain.cones)) - m)
    return upper, UpperProof(y, np.append(above.multipliers, zeros), above.pivots)


def provable_lower(
    wrenches: WrenchSet,
    variables: FloatArray,
    cells: IntArray,
    planes: FloatArray,
    task: Task,
    losses: FloatArray | None = None,
) -> float:
    """Return the largest multiple of a task that provably fits the half-spaces of cells around a centre.

    The centre c is the mean of the first d + 1 vertices; a cell's half-space is ``<a, w - c> <= h``, where h is the
    least ``<a, v - c>`` of its vertices. Vertices that may be elsewhere have lower heights, at which the cells surround
    a point of the scaled task as they surround c if all half-spaces contain it in their interior: on the straight way
    from c to that point, and of the vertices then, no cell is passed.

    Parameters
    ----------
    wrenches : WrenchSet
    variables : (v, l) array
        Of admissible finger forces A u, which exert the vertices.
    cells : (f, d) array
        Vertices of each cell.
    planes : (f, d) array
        Rows a, any: those of ``<a, v - c> = 1`` at the vertices lose least.
    task : Task
    losses : (f, d) array, optional
        Products ``<a, .>`` by which each cell's vertices may be lower than exerted, at least 0.
    """
    d, vertices = len(wrenches.G), wrenches.exert(variables)
    centre = np.mean(vertices[: d + 1], axis=0)
    vertices -= centre
    error = np.abs(variables) @ vertex_rounding(wrenches)
    error += LOSS * (d + sum(wrenches.force_set.lift.shape)) * np.abs(centre) + LOSS * d * np.abs(vertices)
    corners = vertices[cells]
    size, products = np.abs(planes), np.einsum("fvd,fd->fv", corners, planes)
    # the largest error of all vertices is eightfold, and so counts for a vertex and for the centre
    rounding = size @ np.max(error, axis=0)
    heights = np.min(products, axis=1) - rounding
    if not np.min(heights) > 0.0:
        return 0.0
    if losses is not None:
        heights = np.min(products - losses, axis=1) - rounding
    offsets = heights + planes @ centre - LOSS * (2 + d) * (size @ np.abs(centre) + 1.0)
    reach = task.support(planes)[0] + LOSS * 4 * d * _reach_of_sizes(task, size)
    largest = held_multiple(offsets, reach, LOSS)
    if np.min(heights) > 0.0:
        return largest
    middle = largest * np.mean(task.ends(), axis=0)
    is_around = offsets - planes @ middle > LOSS * (2 + d) * (size @ np.abs(middle))
    return largest if np.all(is_around) else 0.0


def vertex_rounding(wrenches: WrenchSet) -> FloatArray:
    """Return bounds on the rounding errors of wrenches ``G A u`` for unit variables, (l, d)."""
    lift = wrenches.force_set.lift
    return np.asarray(LOSS * (len(wrenches.G) + sum(lift.shape)) * (wrenches.sizes @ np.abs(lift)).T)


def trust_in_task(task: Task) -> str:
    """Return what bounds of a task rest on besides real arithmetic: functions that state the supports of its parts."""
    return OWN_SUPPORT if any(part.support_rows() is None for part in parts_of(task)) else ""


def held_multiple(offsets: FloatArray, reach: FloatArray, loss: float) -> float:
    """Return the largest multiple of a set that all half-spaces hold, less a share ``loss``; 0 if there is none.

    Each requires ``alpha * reach <= offset``: one without the origin holds a set beside it from some multiple on.
    """
    largest = float(np.min(offsets[reach > 0.0] / reach[reach > 0.0], initial=np.inf)) * (1.0 - loss)
    is_beside = (reach <= 0.0) & (offsets < 0.0)
    if not largest > 0.0 or np.any(largest * reach[is_beside] > offsets[is_beside]):
        return 0.0
    return largest


def _reach_of_sizes(task: Task, size: FloatArray) -> FloatArray:
    """Return the sums of absolute products in a task's support along directions of absolute components ``size``.

    Parts given by a function count with nothing.
    """
    total = np.zeros(len(size))
    for is_polytope, rows in filter(None, (part.support_rows() for part in parts_of(task))):
        work = size @ np.abs(rows).T
        total += np.max(work, axis=1) if is_polytope else np.sum(work, axis=1)
    return total
