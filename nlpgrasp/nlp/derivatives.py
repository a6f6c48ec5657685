"""Constraint, Jacobian and Lagrangian Hessian functions of a program.

CasADi would colour the Hessian of the whole graph and evaluate it through MX at 10 ms per call. Instead the Lagrangian
is split into an SX part with an exact sparse Hessian, one small block per contact, and the distances. For a distance d
at a point c(z), ``g = d(c(z))``, the chain rule gives ``grad g = J^T d'`` and
``hess g = J^T d'' J + sum_a d'_a hess c_a`` with ``J = dc/dz``. The spline's derivatives d' and d'' are evaluated as
``MX`` and enter ``SX`` functions as numbers.

Repeated constraints are differentiated once (``Repeats``).
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.common.validation import IntArray
from nlpgrasp.nlp.blocks import ConstraintCopy, SplineSurface
from nlpgrasp.nlp.program import Program

UPPER = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # upper triangle of a 3 x 3 matrix, column by column


class ProgramFunctions:
    """Constraint and derivative functions of a program, built on demand.

    Parameters
    ----------
    program : Program
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self._x = ca.MX.sym("x", program.z.shape[0])
        self._p = ca.MX.sym("p", program.theta.shape[0])
        self._sx_count = program.g.shape[0]
        self._linear = ca.vertcat(ca.SX(0, 1), *[part.linear for part in program.spline_surfaces])

    @cached_property
    def is_sx(self) -> bool:
        """Whether the whole program is one ``SX`` graph, for which CasADi's own derivatives are best."""
        faces = all(part.function.is_a("SXFunction") for part in self.program.spline_surfaces)
        return faces and not self.program.distance_parts and self.program.slots is None

    @cached_property
    def nlp(self) -> dict[str, ca.SX] | dict[str, ca.MX]:
        """Program as a dictionary for CasADi's ``nlpsol``, which minimises the negative objective."""
        z, theta = self.program.z, self.program.theta
        if self.is_sx:
            return {"x": z, "p": theta, "f": -self.program.objective, "g": self._sx_program_constraints()}
        objective = ca.Function("objective", [z, theta], [-self.program.objective])
        return {"x": self._x, "p": self._p, "f": objective(self._x, self._p), "g": self._rows}

    @property
    def first_derivatives(self) -> dict[str, ca.Function]:
        """Jacobian function as an option of ``nlpsol``; an empty dictionary if CasADi's own is best."""
        return {} if self.is_sx and not self.program.copies else {"jac_g": self.jacobian}

    @property
    def derivatives(self) -> dict[str, ca.Function]:
        """Jacobian and Hessian functions as options of ``nlpsol``; an empty dictionary if CasADi's own are best."""
        first = self.first_derivatives
        return first and {**first, "hess_lag": self.hessian}

    @cached_property
    def jacobian(self) -> ca.Function:
        """CasADi function of ``(x, p)`` that returns the constraints and their Jacobian."""
        names = (["x", "p"], ["g", "jac_g_x"])
        z, theta = self.program.z, self.program.theta
        if self.is_sx:
            g = self._sx_program_constraints()
            jacobian = ca.vertcat(self._sx_jacobian(), ca.jacobian(g[self._sx_count :], z))
            return ca.Function("jac_g", [z, theta], [g, jacobian], *names)
        points, distances = self.program.points, self.program.distances
        slopes = ca.SX.sym("slopes", points.shape[0])
        blocks = [self._sx_jacobian(), chain_first(ca.jacobian(points, z), slopes, distances)]
        blocks.append(ca.jacobian(self._linear, z))
        smooth = ca.Function("rows_jac", [z, theta, slopes], [ca.vertcat(*blocks)])
        faces = [
            _embed(_face_jacobian(part)(self._x[part.position.range]), part, z.shape[0])
            for part in self.program.spline_surfaces
        ]
        matrix = smooth(self._x, self._p, self._distances.first[1])
        matrix = matrix + ca.vertcat(ca.MX(self._sx_count + distances, z.shape[0]), *faces)
        if self.program.slots is not None:
            matrix = ca.vertcat(self.program.slots.jacobian(self._x, self._p), matrix)
        return ca.Function("jac_g", [self._x, self._p], [self._rows, matrix], *names)

    @cached_property
    def gradient(self) -> ca.Function:
        """CasADi function of ``(x, p, lam_g)`` that returns the gradient of the weighted sum of the constraints.

        The distances' gradients are computed first, as for the Jacobian: through the spline itself a reverse sweep
        takes several times as long.
        """
        program, x, p = self.program, self._x, self._p
        if self.is_sx:
            rows = self._sx_program_constraints()
            weights = ca.SX.sym("lam_g", rows.shape[0])
            weighted = ca.jtimes(rows, program.z, weights, True)
            return ca.Function("gradient", [program.z, program.theta, weights], [weighted])
        lam = ca.MX.sym("lam_g", self._rows.shape[0])
        counts = (0 if program.slots is None else program.slots.count, self._sx_count, program.distances)
        ends = np.cumsum([0, *counts, self._linear.shape[0]]).tolist()
        in_slots, in_rows, in_distances, in_faces = ca.vertsplit(lam, ends)
        slopes = self._distances.first[1] * ca.vec(ca.repmat(in_distances.T, 3, 1))
        symbols = [ca.SX.sym(name, part.shape[0]) for name, part in (("g", in_rows), ("d", slopes), ("h", in_faces))]
        expressions = ca.vertcat(program.g, program.points, self._linear)
        weighted = ca.gradient(ca.dot(ca.vertcat(*symbols), expressions), program.z)
        smooth = ca.Function("weighted", [program.z, program.theta, *symbols], [weighted])
        total = smooth(x, p, in_rows, slopes, in_faces)
        first = 0
        for surface in program.spline_surfaces:
            last, columns = first + surface.linear.shape[0], surface.position
            block = _face_jacobian(surface)(x[columns.range]).T @ in_faces[first:last]
            total += ca.vertcat(ca.MX(columns.start, 1), block, ca.MX(x.shape[0] - columns.stop, 1))
            first = last
        if program.slots is not None:
            total += ca.jtimes(program.slots.rows(x, p), x, in_slots, True)
        return ca.Function("gradient", [x, p, lam], [total])

    @cached_property
    def hessian(self) -> ca.Function:
        """CasADi function of ``(x, p, lam_f, lam_g)`` that returns the Lagrangian's Hessian, upper triangle."""
        names = (["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])
        if self.is_sx:
            return self._sx_program_hessian(*names)
        program, distances = self.program, self.program.distances
        slot_rows = 0 if program.slots is None else program.slots.count
        total = slot_rows + self._sx_count + distances + self._linear.shape[0]
        lam_g, sigma = ca.MX.sym("lam_g", total), ca.MX.sym("lam_f")
        lam = lam_g[slot_rows:]
        slopes, bends = self._distances.second(lam[self._sx_count : self._sx_count + distances])
        matrix = self._expression_hessian()(self._x, self._p, sigma, lam[: self._sx_count], slopes, bends)
        begin = self._sx_count + distances
        for part in program.spline_surfaces:
            rows = part.linear.shape[0]
            block = _face_hessian(part)(self._x[part.position.range], lam[begin : begin + rows])
            matrix = matrix + _embed_square(block, part, program.z.shape[0])
            begin += rows
        if program.slots is not None:
            matrix = matrix + program.slots.hessian(self._x, self._p, lam_g[:slot_rows])
        return ca.Function("hess_lag", [self._x, self._p, sigma, lam_g], [ca.triu(matrix)], *names)

    def _expression_hessian(self) -> ca.Function:
        """Return a function for the upper-triangular Hessian of objective, SX constraints and distances."""
        program, distances = self.program, self.program.distances
        z, points = program.z, program.points
        lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", self._sx_count)
        slopes, bends = ca.SX.sym("slopes", points.shape[0]), ca.SX.sym("bends", 6 * distances)
        weighted = -lam_f * program.objective + ca.dot(slopes, points)
        matrix = self._sx_hessian(weighted, lam_g) + chain_second(ca.jacobian(points, z), bends, distances)
        return ca.Function("rows_hess", [z, program.theta, lam_f, lam_g, slopes, bends], [ca.triu(matrix)])

    @cached_property
    def _distances(self) -> DistanceConstraints:
        """Clearance constraints on spline distances, at the variables ``x``."""
        points = ca.Function("points", [self.program.z, self.program.theta], [self.program.points], {"cse": True})
        return DistanceConstraints(self.program, points(self._x, self._p))

    @cached_property
    def _rows(self) -> ca.MX:
        """All constraints at ``x``, as ``MX``."""
        smooth = ca.Function("rows", [self.program.z, self.program.theta], [self.program.g, self._linear])
        rows, linear = smooth(self._x, self._p)
        faces = [part.function(self._x[part.position.range]) for part in self.program.spline_surfaces]
        slots = ca.MX(0, 1) if self.program.slots is None else self.program.slots.rows(self._x, self._p)
        return ca.vertcat(slots, rows, self._distances.first[0], linear + ca.vertcat(*faces))

    @cached_property
    def _repeats(self) -> Repeats:
        return Repeats(self.program.z, self.program.g, self.program.copies)

    def _sx_jacobian(self) -> ca.SX:
        """Return the Jacobian of the SX constraints."""
        z, g, repeated = self.program.z, self.program.g, self._repeated
        return ca.jacobian(g, z) if not repeated else ca.vertcat(self._repeats.jacobian(), ca.jacobian(g[repeated:], z))

    def _sx_hessian(self, expression: ca.SX, lam: ca.SX) -> ca.SX:
        """Return the Hessian of ``expression`` plus the weighted SX constraints."""
        z, g, repeated = self.program.z, self.program.g, self._repeated
        rest_hessian = ca.hessian(expression + ca.dot(lam[repeated:], g[repeated:]), z)[0]
        return rest_hessian if not repeated else rest_hessian + self._repeats.hessian(lam)

    @property
    def _repeated(self) -> int:
        """Number of repeated constraints, which come first among the SX constraints."""
        return self.program.copies[-1].rows.stop if self.program.copies else 0

    def _sx_program_hessian(self, inputs: list[str], outputs: list[str]) -> ca.Function:
        z, theta, rows = self.program.z, self.program.theta, self._sx_program_constraints()
        lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", rows.shape[0])
        expression = -lam_f * self.program.objective + ca.dot(lam[self._sx_count :], rows[self._sx_count :])
        matrix = ca.triu(self._sx_hessian(expression, lam[: self._sx_count]))
        return ca.Function("hess_lag", [z, theta, lam_f, lam], [matrix], inputs, outputs)

    def _sx_program_constraints(self) -> ca.SX:
        z = self.program.z
        faces = [part.function(z[part.position.range]) + part.linear for part in self.program.spline_surfaces]
        return ca.vertcat(self.program.g, *faces)


def _face_jacobian(part: SplineSurface) -> ca.Function:
    """Return a function for the Jacobian of surface constraints in the contact position."""
    q = ca.MX.sym("q", part.position.stop - part.position.start)
    return ca.Function("face_jac", [q], [ca.jacobian(part.function(q), q)])


def _face_hessian(part: SplineSurface) -> ca.Function:
    """Return a function for the upper-triangular Hessian of weighted surface constraints."""
    q = ca.MX.sym("q", part.position.stop - part.position.start)
    weight = ca.MX.sym("w", part.linear.shape[0])
    return ca.Function("face_hess", [q, weight], [ca.triu(ca.hessian(ca.dot(weight, part.function(q)), q)[0])])


def _embed(block: ca.MX, part: SplineSurface, width: int) -> ca.MX:
    """Return a sparse (rows, width) matrix with a block (rows, space) at a contact position's columns."""
    rows, columns = block.shape[0], part.position
    return ca.horzcat(ca.MX(rows, columns.start), block, ca.MX(rows, width - columns.stop))


def _embed_square(block: ca.MX, part: SplineSurface, width: int) -> ca.MX:
    """Return a sparse (width, width) matrix with a block on the diagonal at a contact position."""
    columns = part.position
    return ca.diagcat(ca.MX(columns.start, columns.start), block, ca.MX(width - columns.stop, width - columns.stop))


class DistanceConstraints:
    """Clearance constraints of a program at ``MX`` points, with derivatives.

    Parameters
    ----------
    program : Program
    points : casadi.MX
        All points, 3 coordinates each, stacked in one column.
    """

    def __init__(self, program: Program, points: ca.MX) -> None:
        self._parts = []
        begin = 0
        for part in program.distance_parts:
            count = len(part.points)
            columns = ca.reshape(points[3 * begin : 3 * (begin + count)], 3, count)
            self._parts.append((part.function, columns, ca.DM(part.scales).T))
            begin += count

    @cached_property
    def first(self) -> tuple[ca.MX, ca.MX]:
        """The constraint values (m,) and their gradients in the points (3 m,)."""
        values, slopes = [ca.MX(0, 1)], [ca.MX(0, 1)]
        for function, points, scales in self._parts:
            q = ca.MX.sym("q", 3)
            d = function(q)
            value_and_slope = ca.Function("distance_jac", [q], [d, ca.gradient(d, q)]).map(points.shape[1])
            value, slope = value_and_slope(points)
            values.append((value / scales).T)
            slopes.append(ca.vec(slope / ca.repmat(scales, 3, 1)))
        return ca.vertcat(*values), ca.vertcat(*slopes)

    def second(self, multipliers: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return weighted gradients (3 m,) and weighted upper-triangular Hessians (6 m,) in the points.

        The weights are the multipliers.
        """
        slopes, bends = [ca.MX(0, 1)], [ca.MX(0, 1)]
        begin = 0
        for function, points, scales in self._parts:
            count = points.shape[1]
            q = ca.MX.sym("q", 3)
            H, gradient = ca.hessian(function(q), q)
            upper = ca.vertcat(*[H[a, b] for a, b in UPPER])
            weight = multipliers[begin : begin + count].T / scales
            slope, bend = ca.Function("distance_hess", [q], [gradient, upper]).map(count)(points)
            slopes.append(ca.vec(slope * ca.repmat(weight, 3, 1)))
            bends.append(ca.vec(bend * ca.repmat(weight, 6, 1)))
            begin += count
        return ca.vertcat(*slopes), ca.vertcat(*bends)


def chain_first(along: ca.SX, slopes: ca.SX, count: int) -> ca.SX:
    """Return the constraints' Jacobian from the points' Jacobian (3 m, n) and the distance gradients (3 m,)."""
    if not count:
        return ca.SX(0, along.shape[1])
    return ca.vertcat(*[ca.mtimes(slopes[3 * i : 3 * i + 3].T, along[3 * i : 3 * i + 3, :]) for i in range(count)])


def chain_second(along: ca.SX, bends: ca.SX, count: int) -> ca.SX:
    """Return ``sum J^T d'' J`` from the points' Jacobian (3 m, n) and the distances' weighted Hessians (6 m,)."""
    total = ca.SX(along.shape[1], along.shape[1])
    for i in range(count):
        J, h = along[3 * i : 3 * i + 3, :], bends[6 * i : 6 * i + 6]
        dependent = sorted(set(J.sparsity().get_triplet()[1]))
        J_dependent = J[:, dependent]
        H = ca.vertcat(ca.horzcat(h[0], h[1], h[3]), ca.horzcat(h[1], h[2], h[4]), ca.horzcat(h[3], h[4], h[5]))
        product = ca.mtimes([J_dependent.T, H, J_dependent])
        rows = [r for _ in dependent for r in dependent]
        columns = [c for c in dependent for _ in dependent]
        shape = ca.Sparsity.triplet(along.shape[1], along.shape[1], rows, columns)
        total = total + ca.SX(shape, ca.vec(ca.densify(product)))
    return total


class Repeats:
    """Derivatives of repeated constraints, from those of the first copy.

    A program with forces at many directions repeats the same constraints: ``g_j = g(s, f_j; theta_j)`` with shared
    variables s. CasADi differentiates only one copy instead of the whole graph, and the others' variables are
    substituted. For pads with forces at four corners that takes a tenth of the time.

    Parameters
    ----------
    z, g : SX
        All variables, and all constraints, with those of the copies first.
    copies : list of ConstraintCopy
        Identical but for their own variables and parameters.
    """

    def __init__(self, z: ca.SX, g: ca.SX, copies: list[ConstraintCopy]) -> None:
        self._z, self._g, self._copies = z, g, copies
        copied = {i for copy in copies for i in range(copy.variables.start, copy.variables.stop)}
        self._shared = [i for i in range(z.shape[0]) if i not in copied]

    @cached_property
    def _first(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Variables, constraints and parameters of the first copy, with the shared variables first."""
        copy = self._copies[0]
        return self._columns_of(copy), ca.cse(self._g[copy.rows.start : copy.rows.stop]), copy.parameters

    def jacobian(self) -> ca.SX:
        """Return the Jacobian (m, n) of the constraints of all copies."""
        x, g, theta = self._first
        function = ca.Function("copy_jac", [x, theta], [ca.jacobian(g, x)], {"cse": True})
        entries = _SparseEntries(self._copies[-1].rows.stop, self._z.shape[0])
        for copy in self._copies:
            columns = self._indices(copy)
            entries.add(
                function(self._columns_of(copy), copy.parameters), np.arange(copy.rows.start, copy.rows.stop), columns
            )
        return entries.matrix()

    def hessian(self, lam: ca.SX) -> ca.SX:
        """Return the Hessian (n, n) of the constraints of all copies, weighted by ``lam`` (m,)."""
        x, g, theta = self._first
        weight = ca.SX.sym("weight", g.shape[0])
        second = ca.hessian(ca.dot(weight, g), x)[0]
        function = ca.Function("copy_hess", [x, theta, weight], [second], {"cse": True})
        entries = _SparseEntries(self._z.shape[0], self._z.shape[0])
        for copy in self._copies:
            columns = self._indices(copy)
            rows = lam[copy.rows.start : copy.rows.stop]
            entries.add(function(self._columns_of(copy), copy.parameters, rows), columns, columns)
        return entries.matrix()

    def _columns_of(self, copy: ConstraintCopy) -> ca.SX:
        return self._z[[int(i) for i in self._indices(copy)]]

    def _indices(self, copy: ConstraintCopy) -> IntArray:
        return np.array([*self._shared, *range(copy.variables.start, copy.variables.stop)])


class _SparseEntries:
    """Builder of a sparse matrix that sums entries at the same position."""

    def __init__(self, rows: int, columns: int) -> None:
        self._shape = rows, columns
        self._sums: dict[tuple[int, int], ca.SX] = {}

    def add(self, block: ca.SX, rows: IntArray, columns: IntArray) -> None:
        """Add a sparse block at given rows and columns."""
        r, c = block.sparsity().get_triplet()
        entries = ca.vertsplit(block.nz[:])
        for i, j, entry in zip(rows[r].tolist(), columns[c].tolist(), entries, strict=True):
            previous = self._sums.get((i, j))
            self._sums[i, j] = entry if previous is None else previous + entry

    def matrix(self) -> ca.SX:
        """Return the assembled sparse matrix."""
        positions = sorted(self._sums, key=lambda position: (position[1], position[0]))
        sparsity = ca.Sparsity.triplet(*self._shape, [i for i, _ in positions], [j for _, j in positions])
        return ca.SX(sparsity, ca.vertcat(*[self._sums[position] for position in positions]))
