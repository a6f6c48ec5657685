"""Values of the rows of constraints and hand at given placements."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.rows import Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import CLEARANCE, PlacementRows, placement_rows


class RowValues:
    """The rows of a problem's constraints and hand as compiled functions.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self.problem = problem

    @cached_property
    def constraint_rows(self) -> tuple[Row, ...]:
        """Rows of the user's constraints and of the hand, in the order of the program."""
        return self._rows[0].named

    @property
    def row_sources(self) -> tuple[tuple[int, ...], ...]:
        """Which rows each constraint gave; then the hand's own, then the clearance of its links."""
        return self._rows[0].sources

    def constraint_values(self, points: FloatArray, normals: FloatArray, hand: dict[str, FloatArray]) -> FloatArray:
        """Return the rows' values in their own units, (b, rows), for placements (b, k, space)."""
        if not self.constraint_rows:
            return np.zeros((len(points), 0))
        b = len(points)
        columns = [points.reshape(b, -1).T, normals.reshape(b, -1).T]
        columns += [np.broadcast_to(v.reshape(b, -1).T, (v.reshape(b, -1).shape[1], b)) for v in hand.values()]
        return np.asarray(self._row_function.map(b)(*columns).full()).T

    def violations(self, points: FloatArray, normals: FloatArray, hand: dict[str, FloatArray]) -> FloatArray:
        """Return each placement's largest violation relative to the rows' scales, (b,), and of face extents not."""
        return self.excess(self.constraint_values(points, normals, hand))

    def excess(self, values: FloatArray) -> FloatArray:
        """Return the largest violation of rows' values (b, m), relative to the rows' scales, (b,)."""
        if not values.shape[1]:
            return np.zeros(len(values))
        lower = np.array([r.lower for r in self.constraint_rows])
        upper = np.array([r.upper for r in self.constraint_rows])
        scale = np.array([r.scale for r in self.constraint_rows])
        excess = np.maximum(lower - values, values - upper) / scale
        return np.asarray(np.max(np.where(np.isfinite(values), np.maximum(excess, 0.0), np.inf), axis=1))

    def blocked(self, points: FloatArray, normals: FloatArray, hand: dict[str, FloatArray]) -> FloatArray:
        """Return the sum of each placement's violated inequalities, relative to the rows' scales, (b,)."""
        values = self.constraint_values(points, normals, hand)
        rows = [i for i, r in enumerate(self.constraint_rows) if r.lower < r.upper]
        lower, upper, scale = (
            np.array([getattr(self.constraint_rows[i], key) for i in rows]) for key in ("lower", "upper", "scale")
        )
        return np.asarray(
            np.sum(np.maximum(np.maximum(lower - values[:, rows], values[:, rows] - upper), 0.0) / scale, axis=1)
        )

    @cached_property
    def clearance_rows(self) -> NDArray[np.intp]:
        """Which of the constraint rows keep a link away from the held body."""
        return np.array([i for i, r in enumerate(self.constraint_rows) if r.name.startswith(CLEARANCE)], dtype=int)

    def tip_centres(self, hand: dict[str, FloatArray], otherwise: FloatArray) -> FloatArray:
        """Return the centres of round fingertips (k, 3), and the given points for the others."""
        centres = self._hand_function(*hand.values())[0].full().T
        return np.where(np.isnan(centres), otherwise, centres)

    def mesh_clearances(self, body: Mesh, hand: dict[str, FloatArray]) -> FloatArray:
        """Return the links' signed distances to the mesh itself, one a clearance row, metres."""
        centres = np.asarray(self._hand_function(*hand.values())[1].full()).T
        if not len(centres):
            return np.zeros(0)
        rough = np.asarray(body.distance_function.map(len(centres))(centres.T).full()).ravel()
        return np.asarray(np.where(rough < 0.0, -1.0, 1.0) * body.closest(centres)[2])

    @cached_property
    def _hand_function(self) -> ca.Function:
        """The hand's variables to the centres of its round fingertips (NaN for others) and of its links' spheres."""
        hand = self.problem.hand
        if hand is None:
            raise InputError("GraspProblem.hand", None, "a hand")
        symbols = hand.symbols(self.problem.body.bounds)
        tips = [ca.SX.nan(3) if c is None else c for c in hand.tip_centres(symbols)]
        spheres = [s.centre for s in hand.spheres(symbols)]
        outputs = [ca.horzcat(*tips), ca.horzcat(ca.SX(3, 0), *spheres)]
        return ca.Function("hand", list(symbols.values()), outputs, {"cse": True})

    @cached_property
    def _rows(self) -> tuple[PlacementRows, list[Any]]:
        """The rows on symbols of their own, and these symbols."""
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
        """Contacts and the hand's variables to the rows' values, in their own units."""
        found, inputs = self._rows
        points = ca.horzcat(ca.SX(self.problem.body.space, 0), *[c.point for c in found.clearances])
        smooth = ca.Function("rows", inputs, [ca.vertcat(*[r.expression for r in found.rows]), points])
        if not found.clearances:
            return ca.Function("rows", inputs, [ca.vertcat(*[r.expression for r in found.rows])])
        symbols = [ca.MX.sym(f"x{i}", s.shape[0]) for i, s in enumerate(inputs)]
        rows, places = smooth(*symbols)
        distances = [c.distance(places[:, i]) for i, c in enumerate(found.clearances)]
        return ca.Function("rows", symbols, [ca.vertcat(rows, *distances)])
