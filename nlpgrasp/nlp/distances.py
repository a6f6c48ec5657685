"""Derivatives of clearance constraints by the chain rule through a spline distance.

For ``g = d(c(z))``: ``grad g = J^T d'`` and ``hess g = J^T d'' J + sum_a d'_a hess c_a`` with ``J = dc/dz``. The
distance's own derivatives are evaluated as ``MX`` (a spline's) and enter ``SX`` functions as numbers.
"""

from __future__ import annotations

import casadi as ca

from nlpgrasp.nlp.program import Program

UPPER = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # upper triangle of a 3 x 3 matrix, column by column


class DistanceRows:
    """Clearance constraints of a program at ``MX`` points, with derivatives.

    Parameters
    ----------
    program : Program
    points : casadi.MX
        All points, 3 coordinates each, stacked in one column.
    """

    def __init__(self, program: Program, points: ca.MX) -> None:
        self._parts = []
        done = 0
        for part in program.distance_parts:
            count = len(part.points)
            here = ca.reshape(points[3 * done : 3 * (done + count)], 3, count)
            self._parts.append((part.function, here, ca.DM(part.scales).T))
            done += count

    def first(self) -> tuple[ca.MX, ca.MX]:
        """Return the constraint values (m,) and their gradients with respect to the points (3 m,)."""
        values, slopes = [ca.MX(0, 1)], [ca.MX(0, 1)]
        for function, points, scales in self._parts:
            q = ca.MX.sym("q", 3)
            d = function(q)
            both = ca.Function("distance_jac", [q], [d, ca.gradient(d, q)]).map(points.shape[1])
            value, slope = both(points)
            values.append((value / scales).T)
            slopes.append(ca.vec(slope / ca.repmat(scales, 3, 1)))
        return ca.vertcat(*values), ca.vertcat(*slopes)

    def second(self, multipliers: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return gradients (3 m,) and upper triangles of the Hessians (6 m,), weighted by multipliers."""
        slopes, bends = [ca.MX(0, 1)], [ca.MX(0, 1)]
        done = 0
        for function, points, scales in self._parts:
            count = points.shape[1]
            q = ca.MX.sym("q", 3)
            H, gradient = ca.hessian(function(q), q)
            upper = ca.vertcat(*[H[a, b] for a, b in UPPER])
            weight = multipliers[done : done + count].T / scales
            slope, bend = ca.Function("distance_hess", [q], [gradient, upper]).map(count)(points)
            slopes.append(ca.vec(slope * ca.repmat(weight, 3, 1)))
            bends.append(ca.vec(bend * ca.repmat(weight, 6, 1)))
            done += count
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
        used = sorted(set(J.sparsity().get_triplet()[1]))
        local = J[:, used]
        H = ca.vertcat(ca.horzcat(h[0], h[1], h[3]), ca.horzcat(h[1], h[2], h[4]), ca.horzcat(h[3], h[4], h[5]))
        product = ca.mtimes([local.T, H, local])
        rows = [r for _ in used for r in used]
        columns = [c for c in used for _ in used]
        shape = ca.Sparsity.triplet(along.shape[1], along.shape[1], rows, columns)
        total = total + ca.SX(shape, ca.vec(ca.densify(product)))
    return total
