"""Builder of nonlinear programs from named blocks of variables, parameters and constraints.

Canonical form: maximise a scalar subject to ``lower <= g(z; theta) <= upper`` and bounds on z. Constraints are
written in SI units; a scaled program divides variables and constraints by their typical sizes. Every block has a name,
so reports say "friction, finger 2, direction 17" instead of "g[57]".

The order of the constraints is fixed: containment (``ConstraintSlots`` or copies of forces), other ``SX`` expressions,
then clearances and surface constraints through splines, which exist only as ``MX``.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.scalar_constraints import Clearance, Label, ScalarConstraint
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.nlp.blocks import (
    HAND,
    Block,
    ConstraintBlock,
    ConstraintCopy,
    DistancePart,
    FaceConstraints,
    Range,
    SplineSurface,
    block_name,
)
from nlpgrasp.problem.candidate_constraints import CandidateConstraints

REACHABILITY, HAND_CONSTRAINTS = "(3.5-15)", "(3.5-16)"  # equations of the paper


@dataclass
class Program:
    """Builder of a nonlinear program from blocks: variables, parameters, constraints and objective.

    Parameters
    ----------
    scaled : bool
        Whether ``z`` and ``g`` are in solver units: a variable less its offset over its scale, a constraint over its
        scale. Otherwise both are in SI units.
    """

    scaled: bool = True
    variables: list[Block] = field(default_factory=list)
    parameters: list[Block] = field(default_factory=list)
    rows: list[ConstraintBlock] = field(default_factory=list)
    distance_parts: list[DistancePart] = field(default_factory=list)
    spline_surfaces: list[SplineSurface] = field(default_factory=list)
    copies: list[ConstraintCopy] = field(default_factory=list)  # repeated constraints that share derivatives
    slots: ConstraintSlots | None = None  # constraints of one function, before all others
    contained: int = 0  # number of containment constraints, which come first
    placement: slice = field(default_factory=lambda: slice(0, 0))  # scalar constraints of constraints and hand
    objective: ca.SX = field(default_factory=ca.SX)
    equation: str = ""  # equation of the paper for the next constraints
    _z: list[ca.SX] = field(default_factory=list)
    _values: list[ca.SX] = field(default_factory=list)  # of the variables, SI units
    _theta: list[ca.SX] = field(default_factory=list)
    _g: list[ca.SX] = field(default_factory=list)
    _bounds: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    _limits: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def variable(
        self,
        kind: str,
        size: int,
        lower: ArrayLike,
        upper: ArrayLike,
        scale: float = 1.0,
        offset: ArrayLike = 0.0,
        *,
        index: int | str | None = None,
        unit: str = "",
    ) -> ca.SX:
        """Add variables, with bounds, scale and offset in SI units, and return them in SI units, (size,)."""
        symbol, start = ca.SX.sym(block_name(kind, index).replace(" ", "_"), size), _next_index(self.variables)
        offsets = _broadcast(offset, size)
        block = Block(start, start + size, scale, kind=kind, index=index, offset=tuple(offsets.tolist()), unit=unit)
        self.variables.append(block)
        self._z.append(symbol)
        low, high = _broadcast(lower, size), _broadcast(upper, size)
        self._bounds.append(((low - offsets) / scale, (high - offsets) / scale) if self.scaled else (low, high))
        value: ca.SX = ca.DM(offsets) + scale * symbol if self.scaled else symbol
        self._values.append(value)
        return value

    def maximise(self, expression: ca.SX, scale: float) -> None:
        """Set the objective to be maximised, and its scale."""
        self.objective = expression / scale if self.scaled else expression

    def parameter(self, kind: str, size: int, index: int | None = None) -> ca.SX:
        """Add parameters and return their symbols (size,)."""
        symbol = ca.SX.sym(block_name(kind, index).replace(" ", "_"), size)
        start = _next_index(self.parameters)
        self.parameters.append(Block(start, start + size, kind=kind, index=index))
        self._theta.append(symbol)
        return symbol

    def constrain(self, constraint: ScalarConstraint) -> None:
        """Add a scalar constraint, or a column of constraints with common limits.

        Call before ``constrain_distance``.
        """
        if self.distance_parts or self.spline_surfaces:
            raise RuntimeError(
                f"{constraint.name}: an SX expression after rows through distances, whose limits it would get"
            )
        expression: ca.SX = constraint.expression
        self._g.append(ca.vec(expression / self._applied(constraint.scale)))
        self._add_constraints(
            constraint, constraint.expression.numel(), (constraint.lower, constraint.upper), constraint.scale
        )

    def constrain_each(self, constraint: ScalarConstraint, symbols: dict[str, ca.SX], count: int) -> None:
        """Add ``count`` scalar constraints that differ only in the values of their parameters.

        Each is at least ``constraint.lower``. Call this first; these constraints are the slots and not in ``g``.

        Parameters
        ----------
        constraint : ScalarConstraint
            On the program's variables and these ``symbols``; its part is followed by the index.
        symbols : dict
            Symbols (columns) by parameter name; the program gets ``count`` values of each.
        count : int
        """
        z = self.z
        begin = _next_index(self.parameters)
        indices = []
        for name, symbol in symbols.items():
            self.parameter(name, symbol.numel() * count)
            indices.append(np.arange(begin, _next_index(self.parameters)).reshape(count, -1).T)
            begin = _next_index(self.parameters)
        if not count:
            return
        columns = np.flatnonzero(ca.which_depends(constraint.expression, z, 1, False))
        inputs = [z[columns.tolist()], ca.vertcat(*symbols.values())]
        function = ca.Function("slot", inputs, [constraint.expression / self._applied(constraint.scale)])
        for j in range(count):
            label = replace(constraint.label, part=f"{constraint.part} {j}")
            self._add_constraints(label, 1, (constraint.lower, np.inf), constraint.scale)
        self.slots = ConstraintSlots(function, columns, np.concatenate(indices))

    def constrain_copies(
        self, template: ForceTemplate, symbols: dict[str, ca.SX], count: int, differentiated: bool
    ) -> None:
        """Add ``count`` copies of the variables and constraints of a ``ForceTemplate``.

        Call before ``constrain``.

        Parameters
        ----------
        template : ForceTemplate
        symbols : dict
            Symbols (columns) by name of the parameters that differ between copies.
        count : int
        differentiated : bool
            Whether derivatives of one copy are reused for the others; else CasADi differentiates all.
        """
        parameters = {}
        for name, symbol in symbols.items():
            parameters[name] = ca.reshape(self.parameter(name, symbol.numel() * count), symbol.numel(), count)
        rows = [ca.vec(row.expression / self._applied(row.scale)) for _, row in template.rows]
        shared = self.z
        function = ca.Function("copy", [shared, template.values, *symbols.values()], [ca.vertcat(*rows)])
        for j in range(count):
            x = self.variable(
                "forces", sum(template.sizes), template.lower, template.upper, template.scale, index=j, unit="N"
            )
            copy_parameters = [values[:, j] for values in parameters.values()]
            self._g.append(function(shared, x, *copy_parameters))
            begin = _next_index(self.rows)
            for self.equation, row in template.rows:
                part = ", ".join(filter(None, (row.part, f"direction {j}")))
                self._add_constraints(
                    replace(row.label, part=part), row.expression.numel(), (row.lower, row.upper), row.scale
                )
            if differentiated:
                self.copies.append(
                    ConstraintCopy(
                        self.variables[-1], Range(begin, _next_index(self.rows)), ca.vertcat(*copy_parameters)
                    )
                )

    def end_containment(self) -> None:
        """Mark all constraints so far as task-containment constraints."""
        self.contained = _next_index(self.rows)

    def constrain_placement(self, constraints: CandidateConstraints, reachability_sources: int) -> None:
        """Add the constraints of reachability and hand, those on spline distances last.

        Those from the first ``reachability_sources`` sources are reachability constraints.
        """
        begin = _next_index(self.rows)
        reachability = {i for rows in constraints.sources[:reachability_sources] for i in rows}
        items: tuple[ScalarConstraint | Clearance, ...] = (*constraints.rows, *constraints.clearances)
        for i, constraint in enumerate(items):
            self.equation = REACHABILITY if i in reachability else HAND_CONSTRAINTS
            if isinstance(constraint, ScalarConstraint):
                self.constrain(constraint)
            else:
                self.constrain_distance(constraint)
        self.placement = slice(begin, begin + len(constraints.named))

    def constrain_distance(self, clearance: Clearance) -> None:
        """Add a clearance constraint on a spline distance.

        Call after ``constrain``.
        """
        if not self.distance_parts or self.distance_parts[-1].function is not clearance.distance:
            self.distance_parts.append(DistancePart(clearance.distance, [], []))
        part = self.distance_parts[-1]
        part.points.append(clearance.point)
        part.scales.append(self._applied(clearance.scale))
        self._add_constraints(clearance, 1, (clearance.lower, np.inf), clearance.scale)

    def constrain_spline_surface(
        self, rows: Sequence[FaceConstraints], function: ca.Function, position: Block, linear: ca.SX
    ) -> None:
        """Add the surface constraints of a contact on a spline surface; call it last.

        ``rows`` are their blocks, with labels and limits; their values are ``function(position) + linear``.
        """
        for row in rows:
            self._add_constraints(row.label, row.size, (row.lower, 0.0), row.scale)
        self.spline_surfaces.append(SplineSurface(function, position, linear))

    def _applied(self, scale: float) -> float:
        return scale if self.scaled else 1.0

    def _add_constraints(self, label: Label, size: int, limits: tuple[float, float], scale: float = 1.0) -> None:
        """Add a block of ``size`` scalar constraints with common limits, but no expressions."""
        start = _next_index(self.rows)
        self.rows.append(ConstraintBlock(start, start + size, scale, label=label.label, equation=self.equation))
        unit = self._applied(scale)
        self._limits.append((np.full(size, limits[0] / unit), np.full(size, limits[1] / unit)))

    def block(self, kind: str, index: int | str | None = None) -> Block:
        """Return the block of variables or parameters with a kind and, if any, an index."""
        wanted = block_name(kind, index)
        return next(b for b in (*self.variables, *self.parameters) if b.name == wanted)

    def blocks(self, kind: str, among: Sequence[Block] | None = None) -> list[Block]:
        """Return all blocks of a kind, in order, among the variables or among given blocks."""
        return [b for b in (self.variables if among is None else among) if b.kind == kind]

    @property
    def hand_blocks(self) -> list[tuple[str, Block]]:
        """Names and blocks of the hand's variables."""
        return [(str(b.index), b) for b in self.blocks(HAND)]

    @property
    def hand_symbols(self) -> dict[str, ca.SX]:
        """Hand's variables by name, as symbols in the hand's units."""
        return {name: self._values[self.variables.index(block)] for name, block in self.hand_blocks}

    def constraint_indices(self, kind: str) -> list[int]:
        """Return the indices of all scalar constraints of a kind."""
        return [i for b in self.rows if b.kind == kind for i in range(b.start, b.stop)]

    def constraint_name(self, row: int) -> str:
        """Return the name of a scalar constraint; in a block of several, with its index."""
        block = next(b for b in self.rows if b.start <= row < b.stop)
        return block.name if block.stop - block.start == 1 else f"{block.name} [{row - block.start}]"

    @property
    def z(self) -> ca.SX:
        """All variables in one column."""
        return ca.vertcat(*self._z)

    @property
    def theta(self) -> ca.SX:
        """All parameters in one column."""
        return ca.vertcat(*self._theta) if self._theta else ca.SX(0, 1)

    @property
    def g(self) -> ca.SX:
        """All SX constraints in one column.

        In the program they are after the slots and before the spline constraints.
        """
        return ca.vertcat(*self._g) if self._g else ca.SX(0, 1)

    @property
    def distances(self) -> int:
        """Number of clearance constraints on spline distances."""
        return sum(len(part.points) for part in self.distance_parts)

    @property
    def points(self) -> ca.SX:
        """Points of the clearance constraints on spline distances, stacked in one column."""
        return ca.vertcat(ca.SX(0, 1), *[point for part in self.distance_parts for point in part.points])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the variables, (n,) each, solver units."""
        return _stacked(self._bounds)

    def trust_region_bounds(self, z: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
        """Return bounds (n,) of a trust region that keeps contact positions within a radius of z, solver units."""
        lower, upper = self.bounds
        for block in self.blocks("position"):
            lower[block.range] = np.maximum(lower[block.range], z[block.range] - radius)
            upper[block.range] = np.minimum(upper[block.range], z[block.range] + radius)
        return lower, upper

    def with_hand_bounds(self, name: str, lower: FloatArray, upper: FloatArray) -> Program:
        """Return a copy with the bounds of one of the hand's variables replaced, (m,) each, in the hand's units."""
        block = self.block(HAND, name)
        result = copy(self)
        result._bounds = list(self._bounds)
        result._bounds[self.variables.index(block)] = lower / block.scale, upper / block.scale
        return result

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits of all scalar constraints, (m,) each, block by block."""
        return _stacked(self._limits)


@dataclass(frozen=True)
class ForceTemplate:
    """Force variables of one direction with their constraints, which a program repeats for every direction.

    Parameters
    ----------
    values : casadi.SX
        Symbol of the variables, SI units.
    lower, upper, scale : float
        Of all variables, SI units.
    sizes : sequence of int
        Number of variables of each contact.
    rows : list of (str, ScalarConstraint)
        Equation of the paper, and constraint on the program's variables, these, and the copy's parameters.
    """

    values: ca.SX
    lower: float
    upper: float
    scale: float
    sizes: Sequence[int]
    rows: list[tuple[str, ScalarConstraint]] = field(default_factory=list)

    @property
    def of_contacts(self) -> list[ca.SX]:
        """Force variables of each contact, as columns."""
        return list(ca.vertsplit(self.values, [0, *accumulate(self.sizes)]))


@dataclass(frozen=True)
class ConstraintSlots:
    """Constraints ``f(x; theta_j)`` of a program that differ only in their parameters theta_j.

    The derivatives of f are built once and mapped over the slots; the Lagrangian's Hessian is their sum. The time to
    build a program therefore does not grow with the number of slots.

    Parameters
    ----------
    function : casadi.Function
        Maps x (s,) and theta_j (q,) to a scalar.
    variables : (s,) array of int
        Indices of x in the program's variables, ascending.
    parameters : (q, m) array of int
        Indices of theta_j in the program's parameters.
    """

    function: ca.Function
    variables: IntArray
    parameters: IntArray

    @property
    def count(self) -> int:
        """Number of constraints."""
        return int(self.parameters.shape[1])

    def rows(self, z: ca.MX, theta: ca.MX) -> ca.MX:
        """Return the constraint values (m, 1), given all variables and parameters of the program."""
        return ca.vec(self._mapped(self.function)(*self._parameters_of(z, theta)))

    def jacobian(self, z: ca.MX, theta: ca.MX) -> ca.MX:
        """Return the constraints' Jacobian (m, n) with respect to all variables."""
        x, t, row = self._symbols
        gradient = ca.Function("slot_jac", [x, t], [ca.gradient(row, x)], {"cse": True})
        values = self._mapped(gradient)(*self._parameters_of(z, theta))
        return ca.MX(self._sparsity(np.arange(self.count), self.count, z.shape[0]), ca.vec(values.T))

    def hessian(self, z: ca.MX, theta: ca.MX, lam: ca.MX) -> ca.MX:
        """Return the Hessian (n, n) of the sum of the constraints, weighted by ``lam`` (m,)."""
        x, t, row = self._symbols
        weight = ca.SX.sym("weight")
        second = ca.densify(ca.hessian(weight * row, x)[0])
        function = ca.Function("slot_hess", [x, t, weight], [second], {"cse": True})
        values = self._mapped(function, [0])(*self._parameters_of(z, theta), lam.T)
        return ca.MX(self._sparsity(self.variables, z.shape[0], z.shape[0]), ca.vec(values))

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Symbols x and theta, and the constraint on them."""
        x, t = ca.SX.sym("x", len(self.variables)), ca.SX.sym("t", self.parameters.shape[0])
        return x, t, self.function(x, t)

    def _mapped(self, function: ca.Function, summed: list[int] | None = None) -> ca.Function:
        """Return a function mapped over all theta_j with shared x; outputs are stacked or summed."""
        return function.map(f"{function.name()}s", "serial", self.count, [0], summed or [], {})

    def _parameters_of(self, z: ca.MX, theta: ca.MX) -> tuple[ca.MX, ca.MX]:
        parameters = ca.reshape(theta[self.parameters.ravel(order="F").tolist()], *self.parameters.shape)
        return z[self.variables.tolist()], parameters

    def _sparsity(self, rows: IntArray, height: int, width: int) -> ca.Sparsity:
        """Return the sparsity pattern of given rows and the columns of x."""
        row_indices, column_indices = np.tile(rows, len(self.variables)), np.repeat(self.variables, len(rows))
        return ca.Sparsity.triplet(height, width, row_indices.tolist(), column_indices.tolist())


def _next_index(blocks: Sequence[Range]) -> int:
    """Return the start index of the next block."""
    return blocks[-1].stop if blocks else 0


def _broadcast(value: ArrayLike, size: int) -> FloatArray:
    """Return an array (size,) from one value for all entries or one for each."""
    return np.array(np.broadcast_to(np.asarray(value, dtype=float), size))


def _stacked(pairs: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper limits of all blocks, (n,) each, from a pair for each block."""
    if not pairs:
        return np.zeros(0), np.zeros(0)
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
