"""Proof of bounds on mu: the forces behind the vertices of the inner polytope, and multipliers along one direction.

The file (docs/proof_format.md) states contacts, force domain and task, and stands alone: a checker that shares no code
with this package verifies it (``verify/proof_checker``). The force domain is stated once, as second-order cones of
variables u: ``x = A u`` with every ``M (u, 1)`` in a second-order cone, which is how contacts and budgets state
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.quadratic_program import cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray, IntArray, number
from nlpgrasp.contacts.product import conic_lift
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.sandwich import held_multiple, tighten
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import parts_of

EPS = float(np.finfo(float).eps)


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
        lift, own = conic_lift(wrenches.contacts, wrenches.space)
        budget = [np.concatenate([M[:, :-1] @ lift, M[:, -1:]], axis=1) for M in wrenches.force_set.cones()]
        return cls(lift, (*[np.pad(M, [(0, 0), (0, 1)]) for M in own], *budget))

    def variables(self, forces: FloatArray) -> FloatArray:
        """Return variables (v, l) of finger forces (v, n): the forces themselves, or those at the corners of pads.

        Corner forces are the solution of a small conic program a vertex. The forces they add up to may differ from the
        given ones by the solver's tolerance: what is proved is of theirs.
        """
        n, count = self.lift.shape
        if n == count and np.array_equal(self.lift, np.eye(n)):
            return forces
        own = [M[:, :-1] for M in self.cones if M[0, -1] == 0.0]
        square = sparse.csc_matrix(np.triu(self.lift.T @ self.lift))
        rows, cones = sparse.csc_matrix(-np.concatenate(own)), [cone_of(M) for M in own]
        settings = quiet_settings(1e-11, 0.99)
        programs = (
            clarabel.DefaultSolver(square, -self.lift.T @ x, rows, np.zeros(rows.shape[0]), cones, settings)
            for x in forces
        )
        return np.array([program.solve().x for program in programs])

    def missing(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return by how much variables (v, l) may be outside their contacts' cones, and the budget's, (v,) each.

        Rounding errors of intervals in a row of m terms, at most ``4 (m + 1) eps sum |M_ij u_j|``, count as outside.
        """
        full = np.concatenate([u, np.ones((len(u), 1))], axis=1)
        outside = np.zeros((2, len(u)))
        for M in self.cones:
            value, error = full @ M.T, 4.0 * (M.shape[1] + 1) * EPS * (np.abs(full) @ np.abs(M).T)
            tail = np.linalg.norm(np.abs(value[:, 1:]) + error[:, 1:], axis=1) * (1.0 + 16.0 * len(M) * EPS)
            of_budget = int(np.any(M[:, -1] != 0.0))
            outside[of_budget] = np.maximum(outside[of_budget], tail - (value[:, 0] - error[:, 0]))
        return outside[0], outside[1]

    def into(self, u: FloatArray) -> FloatArray:
        """Return variables (v, l) next to ``u`` that are inside all cones in spite of rounding."""
        # along the sum of the cones' axes every cone of a pressing contact is wide
        axes = [M[0, :-1] / np.linalg.norm(M[0, :-1]) for M in self.cones if M[0, -1] == 0.0 and np.any(M[0, :-1])]
        inward = np.sum(axes, axis=0) if axes else np.zeros(u.shape[1])
        for _ in range(4):
            cones, budget = self.missing(u)
            if np.all(cones <= 0.0) and np.all(budget <= 0.0):
                break
            u = u + 2.0 * np.maximum(cones, 0.0)[:, None] * inward
            u = u * (1.0 - 2.0 * np.maximum(self.missing(u)[1], 0.0))[:, None]
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


@dataclass(frozen=True)
class IntervalProof:
    """Proof that ``lower <= mu <= upper`` for a grasp and a task (docs/proof_format.md).

    Parameters
    ----------
    claim : str
        Contacts, force domain and task, as ``state_claim`` writes them.
    bounds : Bounds
        Of mu, as proved.
    above : UpperProof
    variables : (v, l) array
        Of the forces that exert the vertices of the inner polytope; those of the first d + 1 are a simplex around its
        centre.
    """

    claim: str
    bounds: Bounds
    above: UpperProof
    variables: FloatArray

    def to_bytes(self) -> bytes:
        """Return the proof file: text, then little-endian doubles."""
        pivots = " ".join(f"{row} {variable}" for row, variable in self.above.pivots)
        text = (
            f"{self.claim}bounds {self.bounds.lower!r} {self.bounds.upper!r}\n"
            f"upper {_wrenches(self.above.direction)} {_numbers(self.above.multipliers)} {pivots}\n"
            f"lower {len(self.variables)}\n"
        )
        return text.encode("ascii") + self.variables.astype("<f8").tobytes()


def state_claim(grasp: Grasp, task: Task, force_budget: str | ForceBudget = "l2") -> str:
    """Return the text of a proof file that says what is proved: contacts, force domain and task.

    Raises
    ------
    InputError
        When a part of the task has no support that can be stated.
    """
    parts = _support_rows(task)
    space = grasp.space
    domain = ForceCones.of(WrenchSet.of(grasp, force_budget))
    frames = np.tile(np.eye(3), (len(grasp), 1, 1))  # rows: normal and tangents, z out of the plane
    frames[:, :space, :space] = grasp.frames.transpose(0, 2, 1)
    coordinates = _coordinates(grasp.dimension)
    lines = [
        "nlpgrasp-proof 1",
        f"coordinates {len(coordinates)} {_integers(coordinates)}",
        f"origin {_numbers(np.pad(grasp.torque_origin, (0, 3 - space)))}",
        f"contacts {len(grasp)}",
    ]
    for p, frame, contact in zip(grasp.points, frames, grasp.contacts, strict=True):
        axes = [coordinates[axis] for axis in contact.axes(space)]
        lines.append(f"{_numbers(np.pad(p, (0, 3 - space)))}  {_numbers(frame)}  {len(axes)} {_integers(axes)}")
    lines += [f"variables {domain.lift.shape[1]}", f"lift {_sparse(domain.lift * grasp.force_unit)}"]
    sizes = [len(M) for M in domain.cones]
    lines.append(f"cones {len(sizes)} {_integers(sizes)} {_sparse(np.concatenate(domain.cones))}")
    lines.append(f"task {len(parts)}")
    lines += [f"{int(is_polytope)} {len(rows)} {_wrenches(rows)}" for is_polytope, rows in parts]
    return "\n".join(lines) + "\n"


def prove(grasp: Grasp, task: Task, rtol: float = 0.01, force_budget: str | ForceBudget = "l2") -> IntervalProof:
    """Return a proof of bounds on mu whose relative width is ``rtol``.

    Raises
    ------
    InputError
        Where mu is 0, the wrenches do not span wrench space, or the task has no support that can be stated.
    """
    claim = state_claim(grasp, task, force_budget)
    wrenches = WrenchSet.of(grasp, force_budget)
    problem, _ = make_containment(wrenches, task)
    if problem is None or problem.rank < grasp.dimension:
        raise InputError("grasp", "forces that do not span wrench space", "a grasp with a positive mu in a proof")
    state = tighten(problem, rtol)
    if state.hull is None or state.upper == 0.0:
        raise InputError("grasp", "mu = 0", "a positive mu in a proof")
    domain = ForceCones.of(wrenches)
    forces, cells = state.hull.vertices()
    variables = domain.into(domain.variables(forces))
    lower = _provable_lower(wrenches.G, domain, variables, cells, task)
    upper, above = _prove_upper(wrenches.G, domain, problem.to_wrench_direction(state.worst), task)
    return IntervalProof(claim, Bounds(lower, upper), above, variables)


def write_proof(
    grasp: Grasp, task: Task, path: str | Path, rtol: float = 0.01, *, force_budget: str | ForceBudget = "l2"
) -> Bounds:
    """Write a proof of bounds on mu that ``nlpgrasp check`` and programs of others can check.

    Parameters
    ----------
    grasp : Grasp
        Of any tool.
    task : Task
        Ellipsoid, polytope or a sum of them, about the grasp's torque origin.
    path : str or Path
        File to write, for example ``grasp.proof``.
    rtol : float
        Relative width of the interval. The file is some 60 kB at 0.01 for four fingers, 30 kB at 0.05.
    force_budget : str or ForceBudget
        As for ``ng.mu``.

    Returns
    -------
    Bounds
        The interval as proved.

    Raises
    ------
    InputError
        Where nothing can be proved: mu is 0, wrenches that do not span wrench space, a task given by a function.
    """
    require_grasp(grasp)
    proof = prove(grasp, task_for(task, grasp), number("rtol", rtol, above=0.0), force_budget)
    write_bytes(path, proof.to_bytes())
    return proof.bounds.of_measure(task.measure, task.paper_beta)


def _prove_upper(G: FloatArray, domain: ForceCones, y: FloatArray, task: Task) -> tuple[float, UpperProof]:
    """Return an upper bound on mu along a direction, and its proof by weak duality.

    With s in the dual of the cones and ``b + M^T s = 0``, ``b = A^T G^T y``: ``phi_W(y) <= <s, constants>``. The conic
    program has its cones narrowed by a margin, so that multipliers of pivot rows may be recomputed with rounding.
    """
    M = np.concatenate(domain.cones)
    b = domain.lift.T @ (G.T @ y)
    starts = np.cumsum([0] + [len(cone) for cone in domain.cones[:-1]])
    pivots = _pivots(domain)
    size = max(float(np.max(np.abs(b))), 1e-300)
    for margin in (1e-9, 1e-8, 1e-7, 1e-6, 1e-5):
        axes = np.zeros(len(M))
        axes[starts] = margin
        program = clarabel.DefaultSolver(
            sparse.csc_matrix((M.shape[1] - 1,) * 2), -(b / size + M[:, :-1].T @ axes), sparse.csc_matrix(-M[:, :-1]),
            M[:, -1], [cone_of(cone) for cone in domain.cones], quiet_settings(1e-11, 0.99),
        )  # fmt: skip
        s = (np.array(program.solve().z) + axes) * size
        for row, variable in pivots:
            s[row] = -(b[variable] + M[:, variable] @ s - M[row, variable] * s[row]) / M[row, variable]
        slack = [s[a] - np.linalg.norm(s[a + 1 : a + len(cone)]) for a, cone in zip(starts, domain.cones, strict=True)]
        if min(slack) > 0.01 * margin * size:
            break
    reach = float(task.support(y[None])[0][0])
    upper = float(M[:, -1] @ s) / reach * (1.0 + 1e-13)
    return upper, UpperProof(y, s, pivots)


def _pivots(domain: ForceCones) -> tuple[tuple[int, int], ...]:
    """Return a row of the stacked cones for each variable, in an order in which they determine each other.

    A row of one variable determines its multiplier last; before, variables without one take a row in which all others
    have one. Rows of the budget's cones are freest, then half-spaces, then other rows, the cones' axes last.
    """
    rows = np.concatenate(domain.cones)[:, :-1] != 0.0
    rank = np.concatenate(
        [
            np.r_[4.0 if M[0, -1] else 3.0 - 2.0 * (len(M) == 1), np.full(len(M) - 1, 0.0 if M[0, -1] else 2.0)]
            for M in domain.cones
        ]
    )
    of_one = np.sum(rows, axis=1) == 1
    is_later = np.any(rows[of_one], axis=0)
    pivots = []
    for variable in [*np.flatnonzero(~is_later), *np.flatnonzero(is_later)]:
        others = np.delete(rows, variable, axis=1)
        is_free = of_one if is_later[variable] else ~np.any(others[:, ~np.delete(is_later, variable)], axis=1)
        options = np.flatnonzero(rows[:, variable] & is_free)
        if not len(options):
            raise InputError("force_budget", "cones without pivots", "cones in which each variable has a row")
        pivots.append((int(options[np.argmin(rank[options])]), int(variable)))
    return tuple(pivots)


def _provable_lower(G: FloatArray, domain: ForceCones, variables: FloatArray, cells: IntArray, task: Task) -> float:
    """Return a lower bound that intervals confirm: each rounding error is counted at eight times its bound."""
    loss = 8.0 * EPS
    wrenches = variables @ domain.lift.T @ G.T
    radius = loss * (len(G) + G.shape[1]) * ((np.abs(variables) @ np.abs(domain.lift).T) @ np.abs(G).T)
    centre = np.mean(wrenches[: len(G) + 1], axis=0)
    radius += np.mean(radius[: len(G) + 1], axis=0)
    corners = (wrenches - centre)[cells]
    planes = np.linalg.solve(corners, np.ones((*cells.shape, 1)))[:, :, 0]
    size = np.abs(planes)
    heights = np.einsum("fvd,fd->fv", corners, planes)
    heights -= np.einsum("fvd,fd->fv", radius[cells] + loss * len(G) * np.abs(corners), size)
    offsets = np.min(heights, axis=1) + planes @ centre - loss * (2 + len(G)) * (size @ np.abs(centre) + 1.0)
    reach = task.support(planes)[0] + loss * 4 * len(G) * _reach_of_sizes(task, size)
    return held_multiple(offsets, reach, loss)


def _reach_of_sizes(task: Task, size: FloatArray) -> FloatArray:
    """Return the sums of absolute products in a task's support along directions of absolute components ``size``."""
    work = [(is_polytope, size @ np.abs(rows).T) for is_polytope, rows in _support_rows(task)]
    return np.asarray(sum(np.max(w, axis=1) if is_polytope else np.sum(w, axis=1) for is_polytope, w in work))


def _support_rows(task: Task) -> list[tuple[bool, FloatArray]]:
    """Return the rows that state the support function of each part of a task."""
    parts = [part.support_rows() for part in parts_of(task)]
    stated = [part for part in parts if part is not None]
    if len(stated) < len(parts):
        raise InputError("task", task, "ellipsoids, polytopes and sums of them in a proof")
    return stated


def _coordinates(dimension: int) -> list[int]:
    """Return the components of a spatial wrench that wrenches of a dimension have."""
    return [0, 1, 5] if dimension == 3 else list(range(6))


def _wrenches(rows: FloatArray) -> str:
    full = np.zeros((*np.shape(rows)[:-1], 6))
    full[..., _coordinates(np.shape(rows)[-1])] = rows
    return _numbers(full)


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _integers(values: Sequence[int]) -> str:
    return " ".join(map(str, values))


def _sparse(matrix: FloatArray) -> str:
    rows, columns = np.nonzero(matrix)
    entries = (f"{r} {c} {float(matrix[r, c])!r}" for r, c in zip(rows, columns, strict=True))
    return f"{len(rows)} {' '.join(entries)}"
