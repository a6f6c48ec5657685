"""Least L2 finger forces for many wrenches at once, by a semismooth Newton method on the dual (theory, Section 5).

``min ||x||^2 / 2  s.t.  G x = w, x in K`` has the dual ``max_y <w, y> - ||P_K(G^T y)||^2 / 2`` with d unknowns
whatever the number of contacts; the primal is ``x = P_K(G^T y)``. The dual is concave, C^1 and piecewise smooth, with
generalised Hessian ``-G P_K'(G^T y) G^T``.

Arrays are components first: each row holds one component for all wrenches and is contiguous, so that every operation
runs over the wrenches. The Hessian's entries are linear in those of the contacts' ``P_Ki'``: one matrix product.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets.base import ranges
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.validation import FloatArray

CHUNK = 2048  # wrenches at once: what the processor's cache holds
TOLERANCE = 1e-12
STEPS = 100
HALVINGS = 25
FLOOR = 1e-14  # of the Hessian's trace, added to its diagonal


def dual_newton(
    wrench_set: WrenchSet, wrenches: FloatArray, tolerance: float = TOLERANCE, limit: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return dual solutions y and forces x for unit wrenches: (m, d) to (m, d) and (m, n).

    Wrenches that need a force of more than ``limit`` are given up as soon as the dual's value shows it.

    A wrench that the contacts cannot produce leaves a residual ``w - G x``, and y grows along a direction that
    separates it from what they can.
    """
    solver = _Solver(wrench_set, tolerance, 0.5 * limit**2)
    parts = [solver.solve(wrenches[a : a + CHUNK].T) for a in range(0, len(wrenches), CHUNK)]
    if not parts:
        return np.zeros((0, len(wrench_set.G))), np.zeros((0, wrench_set.G.shape[1]))
    return np.concatenate([y.T for y, _ in parts]), np.concatenate([x.T for _, x in parts])


class _Solver:
    def __init__(self, wrench_set: WrenchSet, tolerance: float, limit: float) -> None:
        self.tolerance, self.limit = tolerance, limit
        self.G = np.ascontiguousarray(wrench_set.G)
        self.contacts = wrench_set.contacts
        self.where = ranges(wrench_set.contacts, wrench_set.space)
        self.same = all(c == self.contacts[0] for c in self.contacts)
        d = len(self.G)
        self.upper = [(a, b) for a in range(d) for b in range(a, d)]
        # entry (a, b) of G_i P_i' G_i^T per entry of P_i'
        columns = []
        for r in self.where:
            Gi = self.G[:, r]
            product = np.einsum("ap,bq->abpq", Gi, Gi)
            columns.append(np.stack([product[a, b].ravel() for a, b in self.upper]))
        self.assemble = np.concatenate(columns, axis=1)

    def solve(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return y (d, m) and x (n, m)."""
        w = np.ascontiguousarray(w)
        m = w.shape[1]
        y_out, x_out = np.zeros_like(w), np.zeros((self.G.shape[1], m))
        best = np.full(m, np.inf)
        live = np.arange(m)
        y: FloatArray = np.asarray(np.linalg.lstsq(self.G @ self.G.T, w, rcond=None)[0], dtype=np.float64)
        x = self._project(y)
        value, damping = _dual(w, y, x), np.zeros(m)
        for _ in range(STEPS):
            gradient = w - self.G @ x
            residual = np.sqrt(np.sum(gradient**2, axis=0))
            improved = residual < best[live]
            keep = live[improved]
            best[keep] = residual[improved]
            y_out[:, keep], x_out[:, keep] = y[:, improved], x[:, improved]
            going = (residual > self.tolerance) & (value <= self.limit)
            if not going.any():
                break
            if not going.all():
                live, y, x, w = live[going], y[:, going], x[:, going], w[:, going]
                value, gradient, residual, damping = value[going], gradient[:, going], residual[going], damping[going]
            step = self._newton_step(y, gradient, residual, damping)
            moved = self._search(w, y, x, value, gradient, step)
            damping = np.where(moved, 0.01 * damping, np.maximum(1e-6, 100.0 * damping))
            hopeless = damping > 1e6  # at the floor of the arithmetic
            if hopeless.any():
                left = ~hopeless
                live, y, x, w = live[left], y[:, left], x[:, left], w[:, left]
                value, damping = value[left], damping[left]
        return y_out, x_out

    def _newton_step(
        self, y: FloatArray, gradient: FloatArray, residual: FloatArray, damping: FloatArray
    ) -> FloatArray:
        """Return the solution of ``(H + regular I) s = gradient``, by Cholesky over all wrenches at once."""
        entries = self.assemble @ self._derivatives(y)
        d = len(y)
        H: list[list[FloatArray]] = [[np.zeros(0)] * d for _ in range(d)]
        for (a, b), row in zip(self.upper, entries, strict=True):
            H[b][a] = row
        trace = H[0][0].copy()
        for a in range(1, d):
            trace += H[a][a]
        regular = (FLOOR + damping) * trace + 1e-3 * np.minimum(residual, 1.0) ** 2 * np.minimum(residual, 0.1) + 1e-300
        s = [g.copy() for g in gradient]
        for j in range(d):
            pivot = H[j][j] + regular
            for k in range(j):
                pivot = pivot - H[j][k] ** 2
            root = np.sqrt(np.maximum(pivot, regular))
            H[j][j] = root
            for i in range(j + 1, d):
                entry = H[i][j]
                for k in range(j):
                    entry = entry - H[i][k] * H[j][k]
                H[i][j] = entry / root
            for k in range(j):
                s[j] -= H[j][k] * s[k]
            s[j] /= root
        for j in reversed(range(d)):
            for i in range(j + 1, d):
                s[j] -= H[i][j] * s[i]
            s[j] /= H[j][j]
        return np.array(s)

    def _search(
        self, w: FloatArray, y: FloatArray, x: FloatArray, value: FloatArray, gradient: FloatArray, step: FloatArray
    ) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Move y, x and value in place by a step that increases the dual enough; return where one was found."""
        slope = np.sum(gradient * step, axis=0)
        rounding = 1e-14 * np.abs(value)
        trial = y + step
        trial_x = self._project(trial)
        trial_value = _dual(w, trial, trial_x)
        short = np.flatnonzero(trial_value < value + 1e-4 * slope)
        if short.size:  # close to the solution the value no longer tells, the gradient does
            left = np.sum((w[:, short] - self.G @ trial_x[:, short]) ** 2, axis=0)
            nearer = left < 0.5 * np.sum(gradient[:, short] ** 2, axis=0)
            short = short[~(nearer & (trial_value[short] >= value[short] - rounding[short]))]
        length = 1.0
        for _ in range(HALVINGS):
            if not short.size:
                break
            length *= 0.5
            trial[:, short] = y[:, short] + length * step[:, short]
            trial_x[:, short] = self._project(np.ascontiguousarray(trial[:, short]))
            trial_value[short] = _dual(w[:, short], trial[:, short], trial_x[:, short])
            short = short[trial_value[short] < value[short] + 1e-4 * length * slope[short]]
        moved = np.ones(len(value), dtype=bool)
        moved[short] = False
        np.copyto(y, trial, where=moved)
        np.copyto(x, trial_x, where=moved)
        np.copyto(value, trial_value, where=moved)
        return moved

    def _project(self, y: FloatArray) -> FloatArray:
        """Return ``P_K(G^T y)``, (d, m) to (n, m)."""
        z = self.G.T @ y
        if self.same:
            block = z.reshape(len(self.contacts), -1, z.shape[1]).transpose(0, 2, 1)
            return np.ascontiguousarray(self.contacts[0].project(block).transpose(0, 2, 1)).reshape(z.shape)
        parts = [c.project(z[r].T).T for c, r in zip(self.contacts, self.where, strict=True)]
        return np.concatenate(parts)

    def _derivatives(self, y: FloatArray) -> FloatArray:
        """Return the entries of every contact's ``P_Ki'`` as rows, (sum n_i^2, m)."""
        z = self.G.T @ y
        m = z.shape[1]
        if self.same:
            block = z.reshape(len(self.contacts), -1, m).transpose(0, 2, 1)
            return np.moveaxis(self.contacts[0].derivative(block), 1, 3).reshape(-1, m)
        parts = [c.derivative(z[r].T) for c, r in zip(self.contacts, self.where, strict=True)]
        return np.concatenate([np.moveaxis(p, 0, 2).reshape(-1, m) for p in parts])


def _dual(w: FloatArray, y: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("dm,dm->m", w, y) - 0.5 * np.einsum("nm,nm->m", x, x))
