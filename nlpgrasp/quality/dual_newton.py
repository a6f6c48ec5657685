"""Batched least L2 finger forces, by a semismooth Newton method on the dual.

``min ||x||^2 / 2  s.t.  G x = w, x in K`` has the dual ``max_y <w, y> - ||P_K(G^T y)||^2 / 2`` with d unknowns
whatever the number of contacts; the primal is ``x = P_K(G^T y)``. The dual is concave, C^1 and piecewise smooth, with
generalised Hessian ``-G P_K'(G^T y) G^T`` (docs/paper/09_support_functions.md).

Arrays are components first: each row holds one component for all wrenches and is contiguous, so every operation runs
over the wrenches. The Hessian's entries are linear in those of the contacts' ``P_Ki'``: one matrix product. For many
wrenches, some are first solved roughly, and their best solutions are warm starts for all.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from nlpgrasp.common.ldl import solve_columns
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import upper_triangle
from nlpgrasp.contacts.product import have_one_domain
from nlpgrasp.quality.wrench_set import WrenchSet

CHUNK = 16384  # wrenches per batch
MANY = 500  # wrenches above which the first ones give warm starts
SAMPLE, SAMPLE_STEPS = 128, 6  # number of these first ones, and their Newton steps
ACTIVE_SHARE = 0.8  # share of unsolved wrenches below which solved ones are dropped
TOLERANCE = 1e-10  # default residual of unit wrenches at which iterations end
STEPS = 100  # Newton steps, at most
BACKTRACKS, SHORTER = 4, 0.25  # backtracking steps before the Hessian is damped, and the factor on their length
SUFFICIENT = 1e-4  # increase of the dual value over that by its slope from which a step is accepted (Armijo)
NEARER, LOSS = 0.7, 1e-14  # residual over the last from which a step is accepted, and relative loss of value then
LESS_DAMPING, MORE_DAMPING = 0.01, 100.0  # factors on the damping after an accepted and a rejected step
FLOOR = 1e-14  # of the Hessian's trace, added to its diagonal
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e6  # of |G|^2; beyond the latter, rounding prevents progress


def dual_newton(
    wrench_set: WrenchSet, wrenches: FloatArray, tolerance: float = TOLERANCE, limit: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return dual solutions y (m, d) and least L2 forces x (m, n) for unit wrenches (m, d).

    Wrenches that need a force above ``limit`` are abandoned as soon as the dual value shows it.
    A wrench that the contacts cannot produce leaves a residual ``w - G x``, and y grows along a direction that
    separates it from what they can.
    """
    solver = _Solver(wrench_set, tolerance, 0.5 * limit**2)
    w = np.ascontiguousarray(wrenches.T)
    start = solver.unconstrained(w)
    if w.shape[1] > MANY:
        y, x = solver.solve(w[:, :SAMPLE], start[:, :SAMPLE], SAMPLE_STEPS)
        start = _best_start(w, y, np.linalg.norm(x, axis=0), start)
    chunks = [
        solver.solve(np.ascontiguousarray(w[:, a : a + CHUNK]), np.ascontiguousarray(start[:, a : a + CHUNK]), STEPS)
        for a in range(0, max(w.shape[1], 1), CHUNK)
    ]
    return np.concatenate([y.T for y, _ in chunks]), np.concatenate([x.T for _, x in chunks])


def _best_start(w: FloatArray, y: FloatArray, size: FloatArray, default: FloatArray) -> FloatArray:
    """Return the best warm start for each wrench: a multiple ``s y_j`` of a known solution.

    Its dual value is the largest. With ``x_j = P_K(G^T y_j)`` that is ``s = <w, y_j> / |x_j|^2``, where
    ``<w, y_j> / |x_j|`` is largest; the default start where none is positive.
    """
    y, size = y[:, size > 0.0], size[size > 0.0]
    if not size.size:
        return default
    score = w.T @ (y / size)
    best = np.argmax(score, axis=1)
    largest = score[np.arange(len(best)), best]
    return np.where(largest > 0.0, y[:, best] * (largest / size[best]), default)


@dataclass
class _State:
    """Newton iterate of the unsolved wrenches, one per column."""

    index: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    w: FloatArray
    y: FloatArray
    z: FloatArray  # G^T y
    x: FloatArray  # its projection
    value: FloatArray
    gradient: FloatArray
    residual: FloatArray
    damping: FloatArray

    def select_columns(self, columns: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> None:
        """Keep the columns in a mask, and drop the others."""
        for name in (f.name for f in fields(self)):
            setattr(self, name, getattr(self, name)[..., columns])


class _Solver:
    """Semismooth Newton method for many wrenches of one wrench set."""

    def __init__(self, wrench_set: WrenchSet, tolerance: float, limit: float) -> None:
        self.tolerance, self.limit = tolerance, limit
        self.G = np.ascontiguousarray(wrench_set.G)
        self.contacts = wrench_set.contacts
        self.ranges = wrench_set.ranges
        self.is_one_domain = have_one_domain(self.contacts, wrench_set.space)
        self.size = float(np.sum(self.G**2))
        d = len(self.G)
        self.upper = upper_triangle(d)
        columns = []  # entry (a, b) of G_i P_i' G_i^T per entry (p, q) of P_i'
        for r in self.ranges:
            for p, q in upper_triangle(r.stop - r.start):
                outer = np.outer(self.G[:, r.start + p], self.G[:, r.start + q])
                outer = outer if p == q else outer + outer.T
                columns.append(np.array([outer[entry] for entry in self.upper]))
        self.assemble = np.stack(columns, axis=1)

    def unconstrained(self, w: FloatArray) -> FloatArray:
        """Return the solutions without friction cones, ``K = R^n``, as starting points."""
        return np.linalg.pinv(self.G @ self.G.T, hermitian=True) @ w

    def solve(self, w: FloatArray, start: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
        """Return dual solutions y (d, m) and forces x (n, m) by Newton's method."""
        m = w.shape[1]
        y_out, x_out, best = np.zeros_like(w), np.zeros((self.G.shape[1], m)), np.full(m, np.inf)
        state = self._state(np.arange(m), w, start, np.zeros(m))
        for _ in range(steps):
            improved = state.residual < best[state.index]
            improved_indices = state.index[improved]
            best[improved_indices] = state.residual[improved]
            y_out[:, improved_indices], x_out[:, improved_indices] = state.y[:, improved], state.x[:, improved]
            # wrenches beyond the limit, or stopped by rounding, are done too
            is_active = (
                (state.residual > self.tolerance) & (state.value <= self.limit) & (state.damping <= MOST_DAMPING)
            )
            if not is_active.any():
                break
            if is_active.mean() < ACTIVE_SHARE or len(is_active) < MANY:
                state.select_columns(is_active)
            state = self._search(state, self._newton_step(state))
        return y_out, x_out

    def _state(
        self, index: np.ndarray[tuple[int, ...], np.dtype[np.intp]], w: FloatArray, y: FloatArray, damping: FloatArray
    ) -> _State:
        """Return the iterate at y, with its dual value and gradient."""
        z = self.G.T @ y
        x = self._project(z)
        gradient = w - self.G @ x
        value = np.einsum("dm,dm->m", w, y) - 0.5 * np.einsum("nm,nm->m", x, x)
        return _State(index, w, y, z, x, value, gradient, np.sqrt(np.einsum("dm,dm->m", gradient, gradient)), damping)

    def _newton_step(self, state: _State) -> FloatArray:
        """Return the solution of ``(H + shift I) s = gradient`` (d, m)."""
        entries = dict(zip(self.upper, self.assemble @ self._derivatives(state.z), strict=True))
        d = len(state.y)
        trace = np.sum([entries[a, a] for a in range(d)], axis=0)
        scale = np.minimum(state.residual, 0.1)
        shift = FLOOR * trace + state.damping * self.size + 1e-3 * scale**3 + 1e-300
        return solve_columns(entries, shift, state.gradient)

    def _search(self, state: _State, step: FloatArray) -> _State:
        """Return the state after a line search for each wrench, by Armijo's rule.

        A wrench without sufficient increase is unchanged, with more damping.
        """
        slope = np.einsum("dm,dm->m", state.gradient, step)
        trial = self._state(state.index, state.w, state.y + step, LESS_DAMPING * state.damping)
        has_increased = trial.value >= state.value + SUFFICIENT * slope
        # close to the solution the gradient decides, not the value
        is_no_loss = trial.value >= state.value - LOSS * np.abs(state.value)
        is_nearer = (trial.residual < NEARER * state.residual) & is_no_loss
        rejected = np.flatnonzero(~(has_increased | is_nearer))
        length = 1.0
        for _ in range(BACKTRACKS):
            if not rejected.size:
                break
            length *= SHORTER
            y = state.y[:, rejected] + length * step[:, rejected]
            shortened = self._state(state.index[rejected], state.w[:, rejected], y, trial.damping[rejected])
            self._write_columns(trial, rejected, shortened)
            rejected = rejected[shortened.value < state.value[rejected] + SUFFICIENT * length * slope[rejected]]
        if rejected.size:
            unchanged = self._state(
                state.index[rejected], state.w[:, rejected], state.y[:, rejected], state.damping[rejected]
            )
            unchanged.damping = np.maximum(LEAST_DAMPING, MORE_DAMPING * unchanged.damping)
            self._write_columns(trial, rejected, unchanged)
        return trial

    @staticmethod
    def _write_columns(state: _State, columns: np.ndarray[tuple[int, ...], np.dtype[np.intp]], source: _State) -> None:
        for name in (f.name for f in fields(state)):
            if name not in ("index", "w"):
                getattr(state, name)[..., columns] = getattr(source, name)

    def _project(self, z: FloatArray) -> FloatArray:
        """Return the projection ``P_K(z)`` onto the contacts' cones, (n, m)."""
        if self.is_one_domain:
            block = z.reshape(len(self.contacts), self.ranges[0].stop, z.shape[1]).transpose(0, 2, 1)
            return np.ascontiguousarray(self.contacts[0].project(block).transpose(0, 2, 1)).reshape(z.shape)
        return np.concatenate([c.project(z[r].T).T for c, r in zip(self.contacts, self.ranges, strict=True)])

    def _derivatives(self, z: FloatArray) -> FloatArray:
        """Return the upper triangles of every contact's ``P_Ki'`` as rows, (sum n_i (n_i + 1) / 2, m)."""
        m = z.shape[1]
        if self.is_one_domain:
            block = z.reshape(len(self.contacts), self.ranges[0].stop, m).transpose(0, 2, 1)
            return np.moveaxis(self.contacts[0].derivative_entries(block), 0, 1).reshape(self.assemble.shape[1], m)
        return np.concatenate([c.derivative_entries(z[r].T) for c, r in zip(self.contacts, self.ranges, strict=True)])
