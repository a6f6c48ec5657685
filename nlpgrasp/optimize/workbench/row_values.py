"""Values and violations of the constraints of problem and hand at placements."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.rows import CLEARANCE, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import PlacementRows, placement_rows

NARROW = 1e-2  # width, relative to a constraint's scale, below which its limits count as an equation


class RowValues:
    """Compiled functions of the constraints of a problem and its hand.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self.problem = problem

    @cached_property
    def named(self) -> tuple[Row, ...]:
        """Scalar constraints of the user and of the hand, in the order of the program."""
        return self._rows[0].named

    @property
    def sources(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the scalar constraints of each user constraint, of the hand, and of its links' clearance."""
        return self._rows[0].sources

    def values(self, points: FloatArray, normals: FloatArray, hand: Values) -> FloatArray:
        """Return the constraints' values in their own units, (b, rows), for placements (b, k, space)."""
        if not self.named:
            return np.zeros((len(points), 0))
        b = len(points)
        padded = 1 << (b - 1).bit_length()  # CasADi keeps the maps of a function by their size
        columns = [np.resize(v.reshape(b, -1), (padded, v.size // b)).T for v in (points, normals, *hand.values())]
        return np.asarray(self._row_function.map(padded)(*columns).full()).T[:b]

    def violations(self, points: FloatArray, normals: FloatArray, hand: Values) -> FloatArray:
        """Return each placement's largest violation but of face extents, relative to the constraints' scales, (b,)."""
        return self.excess(self.values(points, normals, hand))

    def excess(self, values: FloatArray) -> FloatArray:
        """Return the largest violation of constraint values (b, m), relative to their scales, (b,)."""
        return np.asarray(np.max(self.each_excess(values), axis=1, initial=0.0))

    def each_excess(self, values: FloatArray, band: float = 0.0) -> FloatArray:
        """Return the violation of each constraint value (b, m), relative to its scale, (b, m).

        Narrow rows may be off by a ``band``, relative to their scales.
        """
        lower, upper, scale = (np.array([getattr(r, key) for r in self.named]) for key in ("lower", "upper", "scale"))
        excess = np.maximum(lower - values, values - upper) / scale - band * (upper - lower <= NARROW * scale)
        return np.where(np.isfinite(values), np.maximum(excess, 0.0), np.inf)

    @cached_property
    def dependence(self) -> NDArray[np.bool_]:
        """Sparsity: the contacts, and in the last column the hand, that each constraint depends on, (rows, k + 1)."""
        k, space = len(self.problem.models), self.problem.body.space
        result = np.zeros((len(self.named), k + 1), dtype=bool)
        for i in range(self._row_function.n_in() if self.named else 0):
            rows, columns = self._row_function.jac_sparsity(0, i).get_triplet()
            result[rows, np.array(columns, dtype=int) // space if i < 2 else k] = True
        return result

    def broken(self, points: FloatArray, normals: FloatArray, hand: Values) -> FloatArray:
        """Return the summed violation of the user's inequalities by each placement, as ``blocked``, (b,)."""
        own = {row for rows in self.sources[: len(self.problem.constraints)] for row in rows}
        return self.blocked(points, normals, hand, own) if own else np.zeros(len(points))

    def blocked(
        self, points: FloatArray, normals: FloatArray, hand: Values, of: Collection[int] | None = None
    ) -> FloatArray:
        """Return the summed violation of inequalities by each placement, relative to their scales, (b,).

        Of all rows, or of some by number.
        """
        values = self.values(points, normals, hand)
        rows = [i for i, r in enumerate(self.named) if r.lower < r.upper and (of is None or i in of)]
        lower, upper, scale = (
            np.array([getattr(self.named[i], key) for i in rows]) for key in ("lower", "upper", "scale")
        )
        return np.asarray(
            np.sum(np.maximum(np.maximum(lower - values[:, rows], values[:, rows] - upper), 0.0) / scale, axis=1)
        )

    @cached_property
    def clearances(self) -> NDArray[np.intp]:
        """Indices of the constraints that keep a link away from the held body."""
        return np.array([i for i, r in enumerate(self.named) if r.kind == CLEARANCE], dtype=int)

    @cached_property
    def _rows(self) -> tuple[PlacementRows, list[ca.SX]]:
        """Symbolic constraints with their free symbols."""
        space, k, problem = self.problem.body.space, len(self.problem.models), self.problem
        p, n = ca.SX.sym("p", space * k), ca.SX.sym("n", space * k)
        split = list(range(0, space * k + 1, space))
        symbols = {} if problem.hand is None else problem.hand.symbols(problem.body.bounds)
        found = placement_rows(
            problem.body, problem.constraints, problem.hand, ca.vertsplit(p, split), ca.vertsplit(n, split), symbols
        )
        return found, [p, n, *symbols.values()]

    @cached_property
    def _row_function(self) -> ca.Function:
        """Function of contacts, normals and the hand's variables: the constraints' values, in their own units."""
        found, inputs = self._rows
        points = ca.horzcat(ca.SX(self.problem.body.space, 0), *[c.point for c in found.clearances])
        smooth = ca.Function("rows", inputs, [ca.vertcat(*[r.expression for r in found.rows]), points])
        if not found.clearances:
            return ca.Function("rows", inputs, [ca.vertcat(*[r.expression for r in found.rows])])
        symbols = [ca.MX.sym(f"x{i}", s.shape[0]) for i, s in enumerate(inputs)]
        rows, places = smooth(*symbols)
        distances = [c.distance(places[:, i]) for i, c in enumerate(found.clearances)]
        return ca.Function("rows", symbols, [ca.vertcat(rows, *distances)])
