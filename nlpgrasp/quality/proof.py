"""Proof of bounds on mu: the forces behind the vertices of the inner polytope, and multipliers along one direction.

The file (docs/proof_format.md) states contacts, force domain and task, and stands alone: a checker that shares no code
with this package verifies it (``verify/proof_checker``). The force domain is stated once, as second-order cones of
variables u: ``x = A u`` with every ``M (u, 1)`` in a second-order cone, which is how contacts and budgets state
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.confirmation import RecomputedBounds, reaches, recompute_bounds
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import bound_in_closed_form
from nlpgrasp.quality.provable_ends import ForceCones, UpperProof, provable_upper, provable_zero
from nlpgrasp.quality.sandwich import sandwich
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import parts_of


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
        )
        if self.bounds.lower == 0.0:
            return f"{text}lower\n".encode("ascii")
        return f"{text}lower {len(self.variables)}\n".encode("ascii") + self.variables.astype("<f8").tobytes()


def state_claim(grasp: Grasp, task: Task, force_budget: str | ForceBudget = "l2") -> str:
    """Return the text of a proof file that says what is proved: contacts, force domain and task.

    Raises
    ------
    InputError
        When a part of the task has no support that can be stated.
    """
    parts = [rows for part in parts_of(task) if (rows := part.support_rows()) is not None]
    if len(parts) < len(parts_of(task)):
        raise InputError("task", task, "ellipsoids, polytopes and sums of them in a proof")
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


def prove(
    grasp: Grasp,
    task: Task,
    rtol: float = 0.01,
    force_budget: str | ForceBudget = "l2",
    known: Bounds | None = None,
) -> IntervalProof:
    """Return a proof of bounds on mu whose relative width is ``rtol``, or as near as rounding allows.

    The lower bound is 0 where nothing better is provable: where mu is 0, or wrenches do not span wrench space. Known
    bounds that have kept their vertices are proved as they are. The upper end is along the worst direction found, or
    along that of the known bounds if it is worse.

    Raises
    ------
    InputError
        Where no upper bound is provable, or the task has no support that can be stated.
    """
    claim = state_claim(grasp, task, force_budget)
    wrenches = WrenchSet.of(grasp, force_budget)
    domain = ForceCones.of(wrenches)
    bounds, y = known, None if known is None else known.worst_direction
    if bounds is None or bounds.vertices is None:
        problem, direction = make_containment(wrenches, task)
        bounds = Bounds(0.0, np.inf, direction) if problem is None else sandwich(problem, rtol)
        reach = 0.0 if y is None else float(task.support(y[None])[0][0])
        if y is None or reach <= 0.0 or wrenches.support(y[None])[0][0] >= bounds.upper * reach:
            y = bounds.worst_direction
    lower, variables = 0.0, np.zeros((0, domain.lift.shape[1]))
    if bounds.vertices is not None:
        lower, variables = bounds.lower, domain.into(bounds.vertices)
    if y is None:
        raise InputError("grasp", "no force and no task along any direction", "a task in a proof")
    ends = [provable_upper(wrenches, domain, y, task)]
    if lower == 0.0:
        ends.append(provable_zero(wrenches, domain, y, task))
    upper, above = min(ends, key=lambda end: end[0])
    if not upper < np.inf:
        raise InputError("grasp", "forces of which no upper bound is provable", "bounded forces in a proof")
    return IntervalProof(claim, Bounds(min(lower, upper), upper), above, variables)


def prove_stated(
    stated: Bounds, grasp: Grasp, task: Task, rtol: float = 0.01, force_budget: str | ForceBudget = "l2"
) -> IntervalProof:
    """Return a proof that reaches the lower end of stated bounds on mu, and agrees with the upper end.

    Raises
    ------
    InputError
        Where nothing can be proved (``prove``), or no proof reaches the lower end.
    """
    task, proofs = task_for(task, grasp), list[IntervalProof]()
    allowed = "bounds that a polytope of forces reaches, in a proof"
    if bound_in_closed_form(WrenchSet.of(grasp, force_budget), task) is not None:
        raise InputError("mu", "bounds by singular values, in closed form", allowed)

    if stated.vertices is not None and stated.gap <= rtol:
        return prove(grasp, task, rtol, force_budget, stated)

    def certify(gap: float) -> RecomputedBounds:
        proofs.append(prove(grasp, task, gap, force_budget, replace(stated, vertices=None)))
        return RecomputedBounds(proofs[-1].bounds.lower, proofs[-1].bounds.upper)

    bounds = recompute_bounds(stated, certify, rtol)
    if not reaches(stated, bounds):
        raise InputError("mu", f"at least {stated.lower:.9g}, where {bounds.lower:.9g} is proved", allowed)
    return proofs[-1]


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
        Where nothing can be proved, as for a task given by a function.
    """
    require_grasp(grasp)
    proof = prove(grasp, task_for(task, grasp), number("rtol", rtol, above=0.0), force_budget)
    write_bytes(path, proof.to_bytes())
    return proof.bounds.of_measure(task.measure, task.paper_beta)


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
