"""Named blocks of a nonlinear program, and shared derivatives of repeated constraints.

A program with forces at many directions repeats the same constraints: ``g_j = g(s, f_j; theta_j)`` with shared
variables s. Here CasADi differentiates only one copy instead of the whole graph, and the others' variables are
substituted. For pads with forces at four corners that takes a tenth of the time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.scalar_constraints import Label
from nlpgrasp.problem.candidate_constraints import hand_name

HAND = "hand"  # kind of the hand's variables


@dataclass(frozen=True)
class Range:
    """Index range of a block among all variables, parameters or scalar constraints.

    Parameters
    ----------
    start, stop : int
        Half-open.
    scale : float
        Size of a solver unit in the user's units.
    """

    start: int
    stop: int
    scale: float = 1.0

    @property
    def range(self) -> slice:
        """The range as a slice."""
        return slice(self.start, self.stop)

    @property
    def size(self) -> int:
        """Number of entries."""
        return self.stop - self.start


@dataclass(frozen=True)
class Block(Range):
    """A named block of variables or parameters.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    kind : str
        For example ``"position"``, ``"forces"`` or ``"hand"``.
    index : int or str, optional
        Of a finger or a direction, or the hand's own name of its variable.
    offset : tuple of float
        The solver's zero in the user's units.
    unit : str
        Of the user's values; empty if dimensionless or mixed.
    """

    kind: str = field(kw_only=True)
    index: int | str | None = field(default=None, kw_only=True)
    offset: tuple[float, ...] = field(default=(), kw_only=True)
    unit: str = field(default="", kw_only=True)

    @property
    def name(self) -> str:
        """Kind and index: ``"position 2"``, ``"hand joints"``, ``"beta"``."""
        return block_name(self.kind, self.index)

    @property
    def public_name(self) -> str:
        """Displayed name; a hand's variables by their own names, ``"joints"`` or ``"palm position"``."""
        return hand_name(str(self.index)) if self.kind == HAND else self.name


@dataclass(frozen=True)
class RowBlock(Range):
    """A block of scalar constraints with a common label.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    label : Label
    equation : str
        Its number in the paper.
    """

    label: Label = field(kw_only=True)
    equation: str = field(default="", kw_only=True)

    @property
    def kind(self) -> str:
        """Kind of the label."""
        return self.label.kind

    @property
    def name(self) -> str:
        """Text that names the block in reports."""
        return self.label.name


@dataclass(frozen=True)
class FaceRows:
    """Surface constraints of a contact: at least ``lower``, at most zero."""

    label: Label
    size: int
    scale: float
    lower: float = 0.0


@dataclass
class FacePart:
    """Surface constraints that depend nonlinearly on one contact position only.

    ``rows(p)`` plus a linear expression of the variables. Separate because a mesh's spline exists only as ``MX``, while
    everything else is an ``SX`` graph that evaluates many times faster.
    """

    function: ca.Function  # p (space,) scaled -> rows
    position: Block
    linear: ca.SX  # one entry per row


@dataclass
class DistancePart:
    """Clearance constraints ``distance(point(z)) / scale`` through a body's distance, separate for the same reason."""

    function: ca.Function  # point (space,) metres -> metres
    points: list[ca.SX]  # columns of the variables
    scales: list[float]


def block_name(kind: str, index: int | str | None) -> str:
    """Return the name of a block of variables or parameters."""
    return kind if index is None else f"{kind} {index}"


Places = NDArray[np.intp]


@dataclass(frozen=True)
class Copy:
    """A copy of repeated constraints: its variables, constraints and parameters.

    Parameters
    ----------
    variables, rows : Range
    parameters : SX
        A column.
    """

    variables: Range
    rows: Range
    parameters: ca.SX


class Repeats:
    """Derivatives of all copies' constraints, as expressions of the program's symbols.

    Parameters
    ----------
    z, g : SX
        All variables, and all constraints, with those of the copies first.
    copies : list of Copy
        Identical but for their own variables and parameters.
    """

    def __init__(self, z: ca.SX, g: ca.SX, copies: list[Copy]) -> None:
        self._z, self._g, self._copies = z, g, copies
        own = {i for copy in copies for i in range(copy.variables.start, copy.variables.stop)}
        self._shared = [i for i in range(z.shape[0]) if i not in own]

    @cached_property
    def _first(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Variables of the first copy (shared ones first), its constraints and its parameters."""
        copy = self._copies[0]
        return self._columns_of(copy), ca.cse(self._g[copy.rows.start : copy.rows.stop]), copy.parameters

    def jacobian(self) -> ca.SX:
        """Return the Jacobian (m, n) of the copies' constraints."""
        x, g, theta = self._first
        function = ca.Function("copy_jac", [x, theta], [ca.jacobian(g, x)], {"cse": True})
        found = _Entries(self._copies[-1].rows.stop, self._z.shape[0])
        for copy in self._copies:
            where = self._places(copy)
            found.add(
                function(self._columns_of(copy), copy.parameters), np.arange(copy.rows.start, copy.rows.stop), where
            )
        return found.matrix()

    def hessian(self, lam: ca.SX) -> ca.SX:
        """Return the Hessian (n, n) of the copies' constraints weighted by ``lam`` (m,)."""
        x, g, theta = self._first
        weight = ca.SX.sym("weight", g.shape[0])
        second = ca.hessian(ca.dot(weight, g), x)[0]
        function = ca.Function("copy_hess", [x, theta, weight], [second], {"cse": True})
        found = _Entries(self._z.shape[0], self._z.shape[0])
        for copy in self._copies:
            where = self._places(copy)
            rows = lam[copy.rows.start : copy.rows.stop]
            found.add(function(self._columns_of(copy), copy.parameters, rows), where, where)
        return found.matrix()

    def _columns_of(self, copy: Copy) -> ca.SX:
        return self._z[[int(i) for i in self._places(copy)]]

    def _places(self, copy: Copy) -> Places:
        return np.array([*self._shared, *range(copy.variables.start, copy.variables.stop)])


class _Entries:
    """Builder of a sparse matrix that sums entries at the same position."""

    def __init__(self, rows: int, columns: int) -> None:
        self._shape = rows, columns
        self._sums: dict[tuple[int, int], ca.SX] = {}

    def add(self, block: ca.SX, rows: Places, columns: Places) -> None:
        """Add a sparse block at given rows and columns."""
        r, c = block.sparsity().get_triplet()
        entries = ca.vertsplit(block.nz[:])
        for i, j, entry in zip(rows[r].tolist(), columns[c].tolist(), entries, strict=True):
            before = self._sums.get((i, j))
            self._sums[i, j] = entry if before is None else before + entry

    def matrix(self) -> ca.SX:
        """Return the assembled sparse matrix."""
        places = sorted(self._sums, key=lambda place: (place[1], place[0]))
        sparsity = ca.Sparsity.triplet(*self._shape, [i for i, _ in places], [j for _, j in places])
        return ca.SX(sparsity, ca.vertcat(*[self._sums[place] for place in places]))
