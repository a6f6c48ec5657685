"""Minkowski sums of friction cones: support function, projection and its Jacobian.

Under Coulomb's law and any pressure, the wrench on a line or polygonal pad is that of friction contacts at its ends or
corners (docs/paper/02_contacts.md). With ``u_i`` in the friction cone F of point i

    K = {sum_i A_i u_i : u_i in F},   polar  K° = {y : v_n + mu |v_t| <= 0 for v = A_i^T y of every i}.

The projection is ``P(z) = z - q`` where q is the projection onto the polar cone (Moreau). Read q as the body's motion:
a loaded point either sticks, ``A_i^T q = 0``, or slips. Four methods are tried in turn:

1. ``StickingProjection``: one or two points stick; linear maps.
2. ``ConeSumMembership``: three or more stick; ``q = 0`` and z is a sum of friction forces.
3. ``SlipNewton``: all loaded points slip; Newton's method, which solves nearly all of these.
4. ``AugmentedLagrangian``: all other cases; the method of multipliers, the slowest.

The results of 1 to 3 are checked against conditions that only the projection meets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.ldl import solve_batch, solve_matrices
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.contacts.base import upper_triangle

CHUNK = 4096  # points per batch
LEAST_WORK = 1e-9  # work of unit points below which only rounding is left
POLAR, SLIPS, OTHER, INSIDE = -1, -2, -3, -4  # methods of a projection; from 0: index of the map for sticking points
NONE = -1  # of the maps for sticking points: none projects the point
ROUNDING = 1e-14  # relative tolerance of the conditions on the velocities, and of the last step of a stage
FLAT = 1e-100  # tangential force or speed that counts as zero
# sticking points
RANK = 1e-9  # relative rank tolerance
# sharing of a wrench among the points
MEMBERSHIP_STEPS = 20  # most Newton steps
NARROWER = 1e-3  # relative reduction of friction in F'; height of its apex over the mean normal force
REGULAR = 1e-10  # added to the diagonal of the Hessian
# Newton's method for slipping points
SETS = 4  # active sets tried per problem
SETTLED = 1e-8  # length of the last step, for projections of about unit length: the next would be rounding
EXACT = 4e-14  # tolerance of the KKT conditions, relative to the point
REGULARISATION = 1e-15  # added to the multipliers' matrix, singular where four gradients are dependent
ORDER = [0, 4, 5, 1, 2, 3]  # components reordered: those of normal forces first, then those of tangential forces
INVERSE_ORDER = [0, 3, 4, 5, 1, 2]  # inverse of ORDER
# method of multipliers
FIRST, FACTOR, LAST, MOST = 100.0, 10.0, 1e8, 1e11  # penalty r: first, growth, last for arms of 1 m, largest
COARSE, FINE = 1e-4, 1e-12  # gradient norms, for unit points, that end a stage, and those at the last r
LAST_UPDATES = 8  # most updates of the multipliers at the last r
FAR = 1e-2  # gradient norm above which a stage has failed and its multipliers are not used
STATIONARY = 1e-14  # change by the last update, relative to the point
NEWTON_STEPS, SHORTER = 30, 12  # most Newton steps per stage and backtracking steps


@dataclass(frozen=True)
class FrictionConeSum:
    """Minkowski sum of the friction cones of several points, in wrench components of their common frame.

    Parameters
    ----------
    arms : tuple of N pairs
        Positions of the points along both tangents, metres.
    friction : float
        Coulomb coefficient.
    axes : tuple of n int
        Indices of the components kept of ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)``; the others are zero.
    """

    arms: tuple[tuple[float, float], ...]
    friction: float
    axes: tuple[int, ...]

    @cached_property
    def generators(self) -> FloatArray:
        """Matrix A, (n, 3 N), that maps the points' forces ``(f_n, f_t1, f_t2)`` to wrench components."""
        parts = []
        for a, b in self.arms:
            moments = np.array([[0.0, -b, a], [b, 0.0, 0.0], [-a, 0.0, 0.0]])  # of r x f, r = a t1 + b t2
            parts.append(np.concatenate([np.eye(3), moments])[list(self.axes)])
        return np.concatenate(parts, axis=1)

    def cones(self) -> list[FloatArray]:
        """Return matrices M (3, 3 N): forces u are in the friction cones if all ``M u`` are in second-order cones."""
        scale = np.diag([self.friction, 1.0, 1.0])
        return [np.asarray(np.kron(row[None, :], scale)) for row in np.eye(len(self.arms))]

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the supports (...) along ``z`` (..., n) of the cone with normal force at most 1, and maximisers.

        The maximisers are (..., n). The support is the largest ``v_n + mu |v_t|`` over the points, at least 0, with
        their velocities ``v = A^T z``.
        """
        v = (z @ self.generators).reshape(*z.shape[:-1], len(self.arms), 3)
        size = np.hypot(v[..., 1], v[..., 2])
        work = v[..., 0] + self.friction * size
        best = np.argmax(work, axis=-1)[..., None]
        forces = np.ones_like(v)
        forces[..., 1:] = v[..., 1:] * (self.friction / np.where(size > 0.0, size, 1.0))[..., None]
        value = np.take_along_axis(work, best, axis=-1)[..., 0]
        single = forces * ((np.arange(len(self.arms)) == best) & (value > 0.0)[..., None])[..., None]
        return np.maximum(value, 0.0), single.reshape(*z.shape[:-1], -1) @ self.generators.T

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n) onto the cone."""
        flat, size = _unit_columns(z)
        unit, divisor = self._scale_by_work(flat)
        result = (unit - self._project_polar(unit).q) * (divisor * size)
        result[0] = np.maximum(result[0], 0.0)
        return np.asarray(result.T.reshape(z.shape))

    def project_lifted(self, z: FloatArray) -> FloatArray:
        """Return forces (..., 3 N) of the points, in their cones to rounding, that add up to the projection of z."""
        flat, size = _unit_columns(z)
        unit, divisor = self._scale_by_work(flat)
        projections = self._project_polar(unit)
        u = projections.forces.copy()
        sticks, slips, others = (projections.methods >= 0, *(projections.methods == m for m in (SLIPS, OTHER)))
        if others.any():
            u[..., others] = self._method.forces(unit[:, others], projections.q[:, others], u[..., others])
        u[..., sticks] = self._sticking.forces(unit[:, sticks], projections.methods[sticks])
        v = (self.generators.T @ projections.q[:, slips]).reshape(len(self.arms), 3, int(np.sum(slips)))
        u[:, :1, slips] = projections.weights[:, None, slips]
        friction = self.friction * projections.weights[:, slips] / np.hypot(v[:, 1], v[:, 2]).clip(FLAT)
        u[:, 1:, slips] = friction[:, None] * v[:, 1:]
        return np.asarray((u * (divisor * size)).transpose(2, 0, 1).reshape(*z.shape[:-1], 3 * len(self.arms)))

    def projection_methods(self, z: FloatArray) -> IntArray:
        """Return the method that projects each z (m, n), (m,): a code such as ``SLIPS``, or a linear map's index."""
        return self._project_polar(self._scale_by_work(_unit_columns(z)[0])[0]).methods

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, row by row, (n (n + 1) / 2, ...).

        It depends on the direction of z alone. Inside the cone it is the identity, in the polar cone zero, where
        contacts stick a fixed linear map, where they slip that of Newton's method, else that of the general one.
        """
        flat, _ = _unit_columns(z)
        unit, _ = self._scale_by_work(flat)
        projections, n = self._project_polar(unit), len(flat)  # methods: a sticking map's index, or a code < 0
        matrix = np.zeros((n, n, flat.shape[1]))
        matrix[..., projections.methods == INSIDE] = np.eye(n)[..., None]
        sticks = projections.methods >= 0
        matrix[..., sticks] = self._sticking.maps[projections.methods[sticks]].transpose(1, 2, 0)
        slips, others = np.flatnonzero(projections.methods == SLIPS), np.flatnonzero(projections.methods == OTHER)
        if slips.size:
            padded = np.zeros((6, slips.size))  # in a plane, only some of the axes of space
            padded[list(self.axes)] = projections.q[:, slips]
            full = self._newton.derivative(padded, projections.weights[:, slips])
            matrix[..., slips] = full[np.ix_(self.axes, self.axes)]
        if others.size:
            matrix[..., others] = self._method.derivative(
                unit[:, others], projections.q[:, others], projections.forces[..., others]
            )
        return np.array([matrix[index].reshape(z.shape[:-1]) for index in upper_triangle(n)])

    @cached_property
    def _newton(self) -> SlipNewton:
        return SlipNewton(np.array(self.arms), self.friction)

    @cached_property
    def _method(self) -> AugmentedLagrangian:
        return AugmentedLagrangian(self.generators, np.array(self.arms), self.friction)

    @cached_property
    def _sticking(self) -> StickingProjection:
        return StickingProjection(self.generators, np.array(self.arms), self.friction)

    @cached_property
    def _membership(self) -> ConeSumMembership:
        return ConeSumMembership(self.generators, self.friction)

    @cached_property
    def _last(self) -> list[tuple[FloatArray, _ConeProjection]]:
        """Cache of the last projections, which the derivative often needs next."""
        return []

    def _largest_work(self, v: FloatArray) -> FloatArray:
        """Return the largest ``v_n + mu |v_t|`` over the points, (m,), for velocities (3 N, m)."""
        v = v.reshape(len(self.arms), 3, -1)
        return np.asarray(np.max(v[:, 0] + self.friction * np.hypot(v[:, 1], v[:, 2]), axis=0, initial=-np.inf))

    def _scale_by_work(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (n, m) divided by their largest work, and the divisors (m,).

        Points in the polar cone, of which no work is positive, have the divisor 1.
        """
        work = self._largest_work(self.generators.T @ flat)
        divisor = np.where(work > 0.0, np.maximum(work, LEAST_WORK), 1.0)
        return flat / divisor, divisor

    def _project_polar(self, z: FloatArray) -> _ConeProjection:
        """Project ``z`` (n, m) onto the polar cone, in batches, with a cache of the last result."""
        if self._last and np.array_equal(self._last[0][0], z):
            return self._last[0][1]
        parts = [self._project_batch(z[:, a : a + CHUNK]) for a in range(0, max(1, z.shape[1]), CHUNK)]
        projections = _ConeProjection(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))
        self._last[:] = [(z, projections)]
        return projections

    def _project_batch(self, z: FloatArray) -> _ConeProjection:
        """Project one batch of points ``z`` (n, m) onto the polar cone.

        Each step takes the points that are left: those in the polar cone stay; then come patterns of sticking points;
        points in the cone itself, which project to 0; Newton's method for slipping points; the method of multipliers.
        """
        q, weights = z.copy(), np.zeros((len(self.arms), z.shape[1]))
        forces = np.zeros((len(self.arms), 3, z.shape[1]))
        methods = np.where(self._largest_work(self.generators.T @ z) > 0.0, SLIPS, POLAR)
        remaining = np.flatnonzero(methods == SLIPS)
        maps = self._sticking.find(z[:, remaining])
        sticks = remaining[maps >= 0]
        methods[sticks] = maps[maps >= 0]
        q[:, sticks] -= np.matmul(self._sticking.maps[methods[sticks]], z[:, sticks].T[..., None])[..., 0].T
        remaining = remaining[maps < 0]
        if len(self.arms) > 2:
            forces[..., remaining], is_inside = self._membership.find(z[:, remaining])
            q[:, remaining[is_inside]] = 0.0
            methods[remaining[is_inside]] = INSIDE
            remaining = remaining[~is_inside]
        if remaining.size:
            padded = np.zeros((6, remaining.size))
            padded[list(self.axes)] = z[:, remaining]
            slipping, weights[:, remaining], is_solved = self._newton.solve(padded)
            q[:, remaining] = slipping[list(self.axes)]
            remaining = remaining[~is_solved]
        if remaining.size:
            methods[remaining] = OTHER
            q[:, remaining], forces[..., remaining] = self._method.solve(z[:, remaining])
        return _ConeProjection(q, methods, weights, forces)


class _ConeProjection(NamedTuple):
    """Projections of m points onto the polar cone, with the methods used and the multipliers."""

    q: FloatArray
    methods: IntArray
    weights: FloatArray  # (N, m), where points slip
    forces: FloatArray  # (N, 3, m), inside the cone and where the method of multipliers solves


def _unit_columns(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (..., n) as columns (n, m) scaled to unit length, and their lengths (m,).

    A zero column stays zero.
    """
    flat = z.reshape(-1, z.shape[-1]).T
    largest = np.max(np.abs(flat), axis=0, initial=0.0)
    largest = np.where(largest > 0.0, largest, 1.0)
    length = np.linalg.norm(flat / largest, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return flat / largest / length, largest * length


class StickingProjection:
    """Linear projections onto a sum of friction cones, one for each pattern of sticking and slipping points.

    Where a point sticks the body turns about it, so the slip directions of all others follow from the sign of that
    turn (docs/paper/02_contacts.md):

    * If one point sticks and those of a set S slip with forces ``l_j a_j``, ``(u_i, l_S)`` is the least-squares
      solution of ``A_i u_i + sum_S a_j l_j = z``. It is optimal if u_i is in the friction cone, ``l_S >= 0`` and q is
      in the polar cone.
    * If two points stick, q is a rotation about the line through both, or zero without others; ``z - q`` has to be a
      wrench of two friction contacts, whose forces are unique but for the friction along the line, shared by both.

    In both cases q is in the polar cone, z - q in the cone, and both are orthogonal: conditions that only the
    projection meets.
    """

    def __init__(self, generators: FloatArray, arms: FloatArray, friction: float) -> None:
        self._generators, self._arms, self._friction = generators, arms, friction
        single = [self._maps_of_one_point(i, sign, slipping) for i, sign, slipping in self._patterns()]
        pairs = [pair for pair in combinations(range(len(arms)), 2) if self._can_turn_about(*pair)]
        double = [self._maps_of_two_points(*pair) for pair in pairs]
        rows = max(len(force) for force, _ in single)
        padded = [np.pad(force, [(0, rows - len(force)), (0, 0)]) for force, _ in single]
        self._alone, self._pairs = np.stack(padded), np.stack([force for force, _ in double])
        self._ends = np.array(pairs)
        self._forces = np.stack([forces for _, forces in (*single, *double)])  # z to all points' forces, (3 N, n) each
        self.maps = generators @ self._forces  # z to z - q, each (n, n)

    def find(self, z: FloatArray) -> IntArray:
        """Return the indices (m,) of the linear maps that project points (n, m); ``NONE`` where no map does."""
        mu, count = self._friction, z.shape[1]
        force = (self._alone.reshape(-1, len(z)) @ z).reshape(*self._alone.shape[:2], count)
        is_valid = np.all(force[:, [0, *range(3, force.shape[1])]] >= 0.0, axis=1)
        is_valid &= force[:, 1] ** 2 + force[:, 2] ** 2 <= (mu * force[:, 0]) ** 2 * (1.0 + ROUNDING)
        force = (self._pairs.reshape(-1, len(z)) @ z).reshape(len(self._pairs), 5, count)
        normal_limits, transverse = mu * force[:, :2], np.abs(force[:, 2:4])
        capacity = np.sqrt(np.maximum((normal_limits - transverse) * (normal_limits + transverse), 0.0)).sum(axis=1)
        is_pair_valid = np.all(normal_limits >= transverse, axis=1) & (np.abs(force[:, 4]) <= capacity)
        maps, columns = np.nonzero(np.concatenate([is_valid, is_pair_valid]))
        points = z[:, columns]
        q = points - np.matmul(self.maps[maps], points.T[..., None])[..., 0].T
        v = (self._generators.T @ q).reshape(len(self._arms), 3, -1)
        work = np.max(v[:, 0] + mu * np.hypot(v[:, 1], v[:, 2]), axis=0)
        is_polar = work <= ROUNDING * (1.0 + np.sqrt(np.sum(points**2, axis=0)))
        result = np.full(count, NONE)
        result[columns[is_polar]] = maps[is_polar]
        return result

    def forces(self, z: FloatArray, maps: IntArray) -> FloatArray:
        """Return all points' forces (N, 3, m) that add up to the projections of points (n, m) by given maps (m,).

        Where two points stick, they share the friction along the line between them as their capacities are.
        """
        u = np.matmul(self._forces[maps], z.T[..., None])[..., 0].reshape(len(maps), len(self._arms), 3)
        both = np.flatnonzero(maps >= len(self._alone))
        columns, ends = both[:, None], self._ends[maps[both] - len(self._alone)]  # (b, 1), (b, 2)
        line = self._arms[ends[:, 1]] - self._arms[ends[:, 0]]
        line = (line / np.linalg.norm(line, axis=1, keepdims=True))[:, None]
        force = u[columns, ends]
        along = np.sum(force[..., 1:] * line, axis=2)
        across = force[..., 2] * line[..., 0] - force[..., 1] * line[..., 1]
        capacity = np.sqrt(np.maximum((self._friction * force[..., 0]) ** 2 - across**2, 0.0)) + FLAT
        share = capacity / np.sum(capacity, axis=1, keepdims=True) * np.sum(along, axis=1, keepdims=True)
        u[columns, ends, 1:] += (share - along)[..., None] * line
        return np.asarray(u.transpose(1, 2, 0))

    def _patterns(self) -> list[tuple[int, float, tuple[int, ...]]]:
        """Return all patterns of one sticking point and the points that slip about it.

        Each is ``(sticking point, sign of the turn, slipping points)``.
        """
        indices, count = range(len(self._arms)), self._generators.shape[0] - 3
        result: list[tuple[int, float, tuple[int, ...]]] = []
        for i in indices:
            others = [j for j in indices if j != i]
            result.append((i, 1.0, ()))
            result += [
                (i, sign, slipping)
                for sign in (1.0, -1.0)
                for m in range(1, count)
                for slipping in combinations(others, m)
            ]
        return result

    def _maps_of_one_point(self, i: int, sign: float, slipping: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return the linear maps from z to ``(u_i, l_S)`` and to all points' forces where only point i sticks.

        The points S slip, as the body turns about point i in the sense of ``sign``.
        """
        columns = [np.eye(self._generators.shape[1])[:, 3 * i : 3 * i + 3]]
        for j in slipping:
            first, second = self._arms[j] - self._arms[i]
            slip = sign * self._friction / np.hypot(first, second)
            columns.append(np.zeros((self._generators.shape[1], 1)))
            columns[-1][3 * j : 3 * j + 3, 0] = 1.0, -slip * second, slip * first
        allowed = np.concatenate(columns, axis=1)
        force = np.asarray(np.linalg.pinv(self._generators @ allowed, rcond=RANK))
        return force, allowed @ force

    def _can_turn_about(self, i: int, j: int) -> bool:
        """Return whether the body can turn about the line through two points: no others lie on both sides of it."""
        first, second = self._arms[j] - self._arms[i]
        side = (self._arms - self._arms[i]) @ np.array([-second, first]) / (first**2 + second**2)
        return bool(np.min(side) >= -RANK or np.max(side) <= RANK)

    def _maps_of_two_points(self, i: int, j: int) -> tuple[FloatArray, FloatArray]:
        """Return the linear maps from z to five forces and to all points' forces where two points stick.

        The five are both normal forces, both across the line, and their sum along it.
        """
        e = (self._arms[j] - self._arms[i]) / np.hypot(*(self._arms[j] - self._arms[i]))
        allowed = np.eye(self._generators.shape[1])[:, [*range(3 * i, 3 * i + 3), *range(3 * j, 3 * j + 3)]]
        inverse = np.asarray(np.linalg.pinv(self._generators @ allowed, rcond=RANK))
        turn = np.zeros((5, 6))
        turn[0, 0] = turn[1, 3] = 1.0
        turn[2, 1:3] = turn[3, 4:6] = -e[1], e[0]
        turn[4, 1:3] = turn[4, 4:6] = e
        return turn @ inverse, allowed @ inverse


class ConeSumMembership:
    """Search for friction forces that sum to a given wrench, for points with generators A (n, 3 N).

    ``z = sum_i A_i u_i`` has many solutions ``u = A^+ z + N x``. The minimum of ``sum_i dist(u_i, F')^2`` over x, with
    F' slightly inside the friction cone F, is 0 where z is well inside; a semismooth Newton method approaches it in a
    few steps. Only forces with every u_i in F itself count, which proves membership; wrenches close to the boundary
    are left to other methods.
    """

    def __init__(self, generators: FloatArray, friction: float) -> None:
        self._friction = friction
        self._count = generators.shape[1] // 3
        arms = generators.reshape(len(generators), self._count, 3)
        self._most = np.sum(np.max(np.abs(arms), axis=1) * [1.0, friction, friction], axis=1)
        self._least = np.asarray(np.linalg.pinv(generators))
        self._free = np.asarray(np.linalg.svd(generators)[2][np.linalg.matrix_rank(generators) :].T)
        free = self._free.reshape(self._count, 3, -1)
        self._squares = np.einsum("ipa,iqb->ipqab", free, free).reshape(9 * self._count, -1)

    def find(self, z: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return forces (N, 3, m) in the friction cones that add up to wrenches (n, m), and where any were found, (m,).

        They are 0 elsewhere.
        """
        forces, is_member = np.zeros((self._count, 3, z.shape[1])), np.zeros(z.shape[1], dtype=bool)
        remaining = np.flatnonzero(np.all(np.abs(z) <= self._most[:, None] * z[0], axis=0))
        u = (self._least @ z[:, remaining]).reshape(self._count, 3, -1)
        for step in range(MEMBERSHIP_STEPS):
            if step:
                u = u + self._step(u)
            is_allowed = self._allowed(u)
            is_member[remaining[is_allowed]] = True
            forces[..., remaining[is_allowed]] = u[..., is_allowed]
            remaining, u = remaining[~is_allowed], u[..., ~is_allowed]
            if not remaining.size:
                break
        return forces, is_member

    def _allowed(self, u: FloatArray) -> BoolArray:
        return np.asarray(np.all(np.hypot(u[:, 1], u[:, 2]) <= self._friction * u[:, 0], axis=0))

    def _step(self, u: FloatArray) -> FloatArray:
        """Return the semismooth Newton step of the forces, (N, 3, m)."""
        mu, apex = self._friction * (1.0 - NARROWER), NARROWER * np.mean(u[:, 0], axis=0)
        u = u.copy()
        u[:, 0] -= apex
        size = np.hypot(u[:, 1], u[:, 2])
        pressing = np.maximum(np.maximum(u[:, 0], 0.0), (u[:, 0] + mu * size) / (1.0 + mu**2))
        edge = (size > mu * pressing) & (pressing > 0.0)
        inverse = 1.0 / np.where(size > FLAT, size, 1.0)
        shrink = np.where(size > mu * pressing, mu * pressing * inverse, 1.0)
        direction = u[:, 1:] * inverse[:, None]
        residual = u.copy()
        residual[:, 0] -= pressing
        residual[:, 1:] *= (1.0 - shrink)[:, None]
        slope_weight = edge / (1.0 + mu**2)
        curvature = np.zeros((self._count, 3, 3, u.shape[2]))  # 1 - P_F'
        is_outside = (size > mu * pressing).astype(float)
        curvature[:, 0, 0] = np.where(edge, 1.0 - slope_weight, is_outside)
        curvature[:, 0, 1:] = curvature[:, 1:, 0] = -mu * slope_weight[:, None] * direction
        outer = direction[:, :, None] * direction[:, None]
        curvature[:, 1:, 1:] = (shrink * is_outside - mu**2 * slope_weight)[:, None, None] * outer
        curvature[:, 1, 1] += is_outside * (1.0 - shrink)
        curvature[:, 2, 2] += is_outside * (1.0 - shrink)
        d = self._free.shape[1]
        H = (self._squares.T @ curvature.reshape(9 * self._count, -1)).T.reshape(-1, d, d)
        H[:, range(d), range(d)] += REGULAR
        slope = self._free.T @ residual.reshape(3 * self._count, -1)
        x = np.linalg.solve(H, -slope.T[..., None])[..., 0].T
        return (self._free @ x).reshape(u.shape)


class SlipNewton:
    """Newton's method for the projection onto the polar cone where all loaded points slip.

    The N points are at ``arms`` (N, 2) along both tangents and have equal friction.

    With the velocities ``v_i = A_i^T q`` of the points, ``g_i(q) = v_n + mu |v_t|`` is convex, homogeneous and smooth
    where ``v_t`` is not zero. The nearest q to z with every ``g_i <= 0`` satisfies ``q = z - sum_i l_i a_i(q)``,
    ``a_i = grad g_i``, ``l_i >= 0`` and ``l_i g_i = 0``. One step of Newton's method solves

        H q = z - a l,   l = argmin over l >= 0 of |z - a l| in the metric of H^-1,   H = 1 + sum_i l_i Hess g_i

    since ``a_i^T q = g_i`` and ``Hess g_i q = 0``. H differs from the identity in the components ``(f_t1, f_t2, m_n)``
    alone, where ``Hess g_i = mu / |v_t| p_i p_i^T`` with the unit force across the velocity as p_i. Steps are limited
    such that no loaded point crosses the kink at ``v_t = 0``: each keeps a share of its speed, since all slip at the
    solution. Results are checked against the KKT conditions; points that fail are left to the other methods.
    """

    def __init__(self, arms: FloatArray, friction: float) -> None:
        self._a, self._b = arms[:, :1], arms[:, 1:]
        self._mu = friction
        self._normal = np.stack([np.ones(len(arms)), arms[:, 1], -arms[:, 0]], axis=1)  # of a_i, (N, 3)
        self._gram = (self._normal @ self._normal.T)[..., None]

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return projections q (6, m) of ``z`` (6, m), multipliers (N, m), and where the KKT conditions hold, (m,)."""
        z = z[ORDER]
        q, lam, is_solved = z.copy(), np.zeros((len(self._a), z.shape[1])), np.zeros(z.shape[1], dtype=bool)
        for settings in TRIES:
            remaining = np.flatnonzero(~is_solved)
            if not remaining.size:
                break
            start, multipliers = q[:, remaining], lam[:, remaining]
            if settings.offset is not None:
                start, multipliers = z[:, remaining], np.zeros_like(multipliers)
                start[3:] += settings.offset * np.array([[1.0], [0.7], [0.4]])
            q[:, remaining], lam[:, remaining], is_solved[remaining] = self._iterate(
                z[:, remaining], start, multipliers, settings
            )
        return q[INVERSE_ORDER], lam, is_solved

    def derivative(self, q: FloatArray, lam: FloatArray) -> FloatArray:
        """Return the Jacobians (6, 6, m) of the projection onto the cone where all loaded points slip.

        That of ``z - q`` is ``1 - H^-1 + H^-1 a (a^T H^-1 a)^-1 a^T H^-1``.
        """
        local = self._local_model(q[ORDER], lam)
        matrix = np.where((lam[:, None] > 0.0) & (lam[None] > 0.0), self._products(local), 0.0).transpose(2, 0, 1)
        matrix += np.eye(len(lam)) * np.where(lam > 0.0, REGULARISATION, 1.0).T[:, None, :]
        a = np.zeros((6, *lam.shape))
        a[:3], a[3:] = self._normal.T[..., None], local.weighted_gradients
        a *= lam > 0.0
        result = np.asarray(np.einsum("aim,mij,bjm->abm", a, np.linalg.inv(matrix), a, optimize=True))
        result[3:, 3:] += np.eye(3)[..., None] - local.inverse
        return np.asarray(result[np.ix_(INVERSE_ORDER, INVERSE_ORDER)])

    def _iterate(
        self, z: FloatArray, q: FloatArray, lam: FloatArray, settings: _NewtonSettings
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Run Newton's method as in ``solve`` from given q and multipliers."""
        size = 1.0 + np.sqrt(np.sum(z**2, axis=0))
        q_all, lam_all = q.copy(), lam.copy()
        active, points, limit = np.arange(z.shape[1]), z, size
        for _ in range(settings.steps):
            local = self._local_model(q, lam)
            step, multipliers = self._step(points, local, lam, REGULARISATION * limit)
            step -= q
            length = self._step_lengths(local, step, multipliers, settings.kept_fraction)
            q, lam = q + length * step, lam + length * (multipliers - lam)
            q_all[:, active], lam_all[:, active] = q, lam
            is_moving = np.max(np.abs(step), axis=0) > SETTLED + 0.5 * EXACT * limit
            if not is_moving.any():
                break
            if not is_moving.all():
                indices = np.flatnonzero(is_moving)
                active, q, lam, points, limit = (
                    active[indices],
                    q[:, indices],
                    lam[:, indices],
                    points[:, indices],
                    limit[indices],
                )
        return q_all, lam_all, self._satisfies_kkt(z, q_all, lam_all, EXACT * size)

    def _step_lengths(
        self, local: _LocalModel, step: FloatArray, multipliers: FloatArray, kept_fraction: float
    ) -> FloatArray:
        """Return the step lengths (m,) at which every loaded point keeps at least a fraction of its slip speed."""
        loss = -local.slip[0] * (step[3] - self._b * step[5]) - local.slip[1] * (step[4] + self._a * step[5])
        allowance = (1.0 - kept_fraction) * local.speed**2
        limiting_loss = np.where(multipliers > 0.0, np.maximum(loss, allowance), allowance)  # the full step or less
        return np.asarray(np.min(allowance / limiting_loss.clip(FLAT), axis=0))

    def _step(
        self, z: FloatArray, local: _LocalModel, lam: FloatArray, least: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        z_t = np.einsum("abm,bm->am", local.inverse, z[3:])
        right = self._normal @ z[:3] + np.einsum("aim,am->im", local.gradients, z_t)
        active = (lam > 0.0) | (local.values > least)
        lam = minimise_nonnegative(self._products(local), right, active, least, REGULARISATION)
        q = np.empty_like(z)
        q[:3] = z[:3] - self._normal.T @ lam
        q[3:] = z_t - np.einsum("aim,im->am", local.weighted_gradients, lam)
        return q, lam

    def _local_model(self, q: FloatArray, lam: FloatArray) -> _LocalModel:
        a, b, mu = self._a, self._b, self._mu
        slip, gradients, transverse = np.empty((2, *lam.shape)), np.empty((3, *lam.shape)), np.empty((3, *lam.shape))
        slip[0], slip[1] = q[3] - b * q[5], q[4] + a * q[5]
        speed = np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
        values = self._normal @ q[:3] + mu * speed
        inverse = 1.0 / np.where(speed > FLAT, speed, 1.0)
        first, second = slip * inverse
        gradients[0], gradients[1], gradients[2] = first, second, a * second - b * first
        gradients *= mu
        transverse[0], transverse[1], transverse[2] = -second, first, a * first + b * second
        H = np.einsum("aim,bim->abm", transverse * (mu * lam * inverse), transverse)
        inverted = _inverse_of_one_plus(H)
        return _LocalModel(slip, speed, values, gradients, inverted, np.einsum("abm,bim->aim", inverted, gradients))

    def _products(self, local: _LocalModel) -> FloatArray:
        """Return the Gram matrices (N, N, m) of the constraint gradients a in the metric of the inverse Hessian.

        These are ``a^T H^-1 a``.
        """
        return np.asarray(self._gram + np.einsum("aim,ajm->ijm", local.gradients, local.weighted_gradients))

    def _satisfies_kkt(self, z: FloatArray, q: FloatArray, lam: FloatArray, limit: FloatArray) -> BoolArray:
        """Return whether the KKT conditions hold, (m,): feasibility, complementarity, stationarity."""
        local = self._local_model(q, lam)
        residual = q - z
        residual[:3] += self._normal.T @ lam
        residual[3:] += np.einsum("aim,im->am", local.gradients, lam)
        largest = np.maximum(np.max(local.values, axis=0), np.max(np.abs(local.values * lam), axis=0))
        return np.asarray((largest <= limit) & (np.max(np.abs(residual), axis=0) <= limit))


class _NewtonSettings(NamedTuple):
    """Settings of a Newton run: least fraction of slip speed kept, number of steps, offset of the start.

    Without an offset the run continues from the last iterate.
    """

    kept_fraction: float
    steps: int
    offset: float | None


TRIES = (
    _NewtonSettings(0.2, 20, 0.0),
    _NewtonSettings(0.01, 3, None),
    _NewtonSettings(0.2, 24, 0.3),
)  # the first mostly takes 4 or 5 steps


class _LocalModel(NamedTuple):
    """Quantities of a Newton step for slipping points, at given q and multipliers."""

    slip: FloatArray  # (2, N, m): tangential velocities v_t
    speed: FloatArray  # (N, m): |v_t|
    values: FloatArray  # (N, m): g_i
    gradients: FloatArray  # (3, N, m): components (f_t1, f_t2, m_n) of a
    inverse: FloatArray  # (3, 3, m): those of H^-1
    weighted_gradients: FloatArray  # (3, N, m): those of H^-1 a


def _inverse_of_one_plus(H: FloatArray) -> FloatArray:
    """Return the inverses of ``1 + H`` for positive semidefinite matrices H (3, 3, m)."""
    # 1 + H = L D L^T with D^-1 = diag(first, second, third), L = [1, 0, 0; a, 1, 0; lower, c, 1]; pivots are at least 1
    first = 1.0 / (1.0 + H[0, 0])
    a, lower = H[0, 1] * first, H[0, 2] * first
    second = 1.0 / np.maximum(1.0 + H[1, 1] - a * H[0, 1], 1.0)
    complement = H[1, 2] - a * H[0, 2]
    c = complement * second
    third = 1.0 / np.maximum(1.0 + H[2, 2] - lower * H[0, 2] - c * complement, 1.0)
    b = a * c - lower  # L^-1 = [1, 0, 0; -a, 1, 0; b, -c, 1], and the inverse is L^-T D^-1 L^-1
    result = np.empty_like(H)
    result[2, 2] = third
    result[1, 2] = result[2, 1] = -c * third
    result[0, 2] = result[2, 0] = b * third
    result[1, 1] = second + c * c * third
    result[0, 1] = result[1, 0] = -a * second - b * c * third
    result[0, 0] = first + a * a * second + b * b * third
    return result


def minimise_nonnegative(
    matrix: FloatArray, right: FloatArray, positive: BoolArray, least: FloatArray, shift: float
) -> FloatArray:
    """Minimise ``x^T M x / 2 - right^T x`` over ``x >= 0`` for m small problems, by an active-set method.

    Parameters
    ----------
    matrix : (N, N, m) array
        Symmetric, positive semidefinite.
    right : (N, m) array
    positive : (N, m) array of bool
        Guess of the positive entries of x.
    least : (m,) array
        Tolerance of the gradient at x = 0.
    shift : float
        Added to the diagonal of M, in case it is singular.

    Returns
    -------
    (N, m) array
        Result of the last active set tried: nearly always the minimiser.
    """
    minimisers = _minimise_free(matrix, right, positive, shift)
    x, unsettled = minimisers, np.arange(right.shape[1])  # problems whose active set still changes
    for _ in range(SETS - 1):
        lowers_cost = right - np.einsum("ijm,jm->im", matrix, x) > least
        guess = np.where(positive, x > 0.0, lowers_cost)
        changed = np.flatnonzero((guess != positive).any(axis=0))
        if not changed.size:
            break
        unsettled, positive, least = unsettled[changed], guess[:, changed], least[changed]
        matrix, right = matrix[:, :, changed], right[:, changed]
        x = _minimise_free(matrix, right, positive, shift)
        minimisers[:, unsettled] = x
    return np.maximum(minimisers, 0.0)


def _minimise_free(matrix: FloatArray, right: FloatArray, active: BoolArray, shift: float) -> FloatArray:
    """Return the minimisers (N, m), of any sign, with the inactive components fixed at zero."""
    restricted = matrix * (active[:, None] & active)
    restricted.reshape(-1, right.shape[1])[:: len(right) + 1] += ~active  # its diagonal
    return solve_matrices(restricted, shift, right * active)


class AugmentedLagrangian:
    """Method of multipliers for the projection onto the polar cone.

    The N points have generators A (n, 3 N), positions ``arms`` (N, 2) and equal friction.

    Each stage minimises ``|q - z|^2 / 2 + sum_i |P_F(u_i + r A_i^T q)|^2 / (2 r)`` by a semismooth Newton method with
    the closed form of ``P_F``, then sets ``u_i = P_F(u_i + r A_i^T q)`` and increases r.
    """

    def __init__(self, generators: FloatArray, arms: FloatArray, friction: float) -> None:
        self._generators, self._count, self._friction = generators, len(arms), friction
        self._upper = upper_triangle(len(generators))
        shortest = np.min(np.abs(arms)[np.abs(arms) > 1e-9 * np.max(np.abs(arms))])
        self._last = float(min(MOST, LAST / min(1.0, shortest) ** 2))  # moments of short arms weigh little
        columns = []  # entries (a, b) of A P' A^T per entry (p, q) of every point's 3 by 3 matrix P'
        for part in np.split(generators, len(arms), axis=1):
            for p, q in upper_triangle(3):
                product = np.outer(part[:, p], part[:, q])
                product = product if p == q else product + product.T
                columns.append(np.array([product[index] for index in self._upper]))
        self._assemble = np.stack(columns, axis=1)

    def derivative(self, z: FloatArray, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the Jacobians (n, n, m) of the projection onto the cone.

        That of ``z - q`` is ``1 - (1 + r A P_F' A^T)^-1`` for large r.
        """
        n, m = z.shape
        matrix = np.empty((m, n, n))
        entries = self._curvature(self._evaluate(z, q, u, self._last), self._last)
        for (a, b), entry in zip(self._upper, entries, strict=True):
            matrix[:, a, b] = matrix[:, b, a] = entry + (a == b)
        inverse = np.linalg.inv(matrix).transpose(1, 2, 0)
        return np.asarray(np.eye(n)[..., None] - 0.5 * (inverse + inverse.transpose(1, 0, 2)))

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return projections q (n, m) of ``z`` (n, m) onto the polar cone and friction forces u (N, 3, m)."""
        q, u, r = z.copy(), np.zeros((self._count, 3, z.shape[1])), FIRST
        while r < self._last:
            q = self._minimise(z, q, u, r, COARSE)
            evaluation = self._evaluate(z, q, u, r)
            u = np.where(np.linalg.norm(evaluation.gradient, axis=0) < FAR, evaluation.forces, u)
            r *= FACTOR
        active = np.arange(z.shape[1])
        for _ in range(LAST_UPDATES):
            previous = q[:, active]
            q[:, active] = self._minimise(z[:, active], previous, u[:, :, active], self._last, FINE)
            evaluation = self._evaluate(z[:, active], q[:, active], u[:, :, active], self._last)
            is_near = np.linalg.norm(evaluation.gradient, axis=0) < FAR
            u[:, :, active] = np.where(is_near, evaluation.forces, u[:, :, active])
            change = np.linalg.norm(q[:, active] - previous, axis=0)
            active = active[change > STATIONARY * (1.0 + np.linalg.norm(previous, axis=0))]
            if not active.size:
                break
        return q, u

    def forces(self, z: FloatArray, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return friction forces (N, 3, m) that add up to ``z - q`` more closely than those of ``solve``.

        These add up to it to r times rounding. Updates with the root of that r lead from there to others.
        """
        r = float(np.sqrt(self._last))
        for _ in range(LAST_UPDATES):
            q = self._minimise(z, q, u, r, FINE)
            u = self._evaluate(z, q, u, r).forces
        return u

    def _minimise(self, z: FloatArray, q: FloatArray, u: FloatArray, r: float, tolerance: float) -> FloatArray:
        """Return the minimisers (n, m) of one stage by Newton's method, started from q."""
        q, current, active = q.copy(), self._evaluate(z, q, u, r), np.arange(z.shape[1])
        for _ in range(NEWTON_STEPS):
            entries = dict(zip(self._upper, self._curvature(current, r), strict=True))
            step = -solve_batch(entries, np.ones(len(active)), current.gradient)
            slope, size = np.sum(current.gradient * step, axis=0), np.linalg.norm(current.gradient, axis=0)
            for _ in range(SHORTER):
                trial = self._evaluate(z, q[:, active] + step, u, r)
                residual = np.linalg.norm(trial.gradient, axis=0)
                is_uphill = (trial.value > current.value + 1e-4 * slope) & (residual > 0.5 * size)
                if not is_uphill.any():
                    break
                step[:, is_uphill] *= 0.25
                slope[is_uphill] *= 0.25
            else:
                trial = self._evaluate(z, q[:, active] + step, u, r)
                residual = np.linalg.norm(trial.gradient, axis=0)
            q[:, active] += step
            rounding = ROUNDING * (1.0 + np.linalg.norm(q[:, active], axis=0))
            is_moving = (residual > tolerance) & (np.linalg.norm(step, axis=0) > rounding)
            if not is_moving.any():
                break
            active, z, u = active[is_moving], z[:, is_moving], u[:, :, is_moving]
            current = _Projections(*(part[..., is_moving] for part in trial))
        return q

    def _evaluate(self, z: FloatArray, q: FloatArray, u: FloatArray, r: float) -> _Projections:
        """Return the projections, gradient and value of the augmented Lagrangian at ``w = u + r A^T q``."""
        mu = self._friction
        w = u + r * (self._generators.T @ q).reshape(u.shape)
        size = np.hypot(w[:, 1], w[:, 2])
        pressing = np.maximum(np.maximum(w[:, 0], 0.0), (w[:, 0] + mu * size) / (1.0 + mu**2))
        is_outside = size > mu * pressing
        shrink = np.where(is_outside, mu * pressing / np.where(size > 0.0, size, 1.0), 1.0)
        forces = np.stack([pressing, w[:, 1] * shrink, w[:, 2] * shrink], axis=1)
        difference = q - z
        gradient = difference + self._generators @ forces.reshape(self._generators.shape[1], -1)
        value = np.sum(q * (0.5 * q - z), axis=0) + np.sum(forces**2, axis=(0, 1)) / (2.0 * r)
        return _Projections(forces, shrink, is_outside.astype(float), w, gradient, value)

    def _curvature(self, evaluation: _Projections, r: float) -> FloatArray:
        """Return the Hessians of the penalty term as upper triangles (n (n + 1) / 2, m).

        These are ``r A P_F'(w) A^T``.
        """
        mu = self._friction
        pressed = (evaluation.forces[:, 0] > 0.0).astype(float)
        edge = pressed * evaluation.outside
        size = np.hypot(evaluation.w[:, 1], evaluation.w[:, 2])
        first, second = evaluation.w[:, 1:].transpose(1, 0, 2) / np.where(size > 0.0, size, 1.0)
        weight = pressed / (1.0 + mu**2 * edge)
        transverse = edge * evaluation.shrink  # of the tangential part across w's own
        slope = edge * mu
        tangential = pressed - edge + transverse
        entries = [
            weight,
            weight * slope * first,
            weight * slope * second,
            (weight * slope**2 - transverse) * first**2 + tangential,
            (weight * slope**2 - transverse) * first * second,
            (weight * slope**2 - transverse) * second**2 + tangential,
        ]
        return np.asarray(r * (self._assemble @ np.stack(entries, axis=1).reshape(self._assemble.shape[1], -1)))


class _Projections(NamedTuple):
    """Projections ``P_F(w)`` at every point, with value and gradient of the augmented Lagrangian."""

    forces: FloatArray  # (N, 3, m)
    shrink: FloatArray  # (N, m): scale of the tangential part
    outside: FloatArray  # (N, m): 1 where w is outside F, else 0
    w: FloatArray
    gradient: FloatArray  # (n, m)
    value: FloatArray  # (m,)
