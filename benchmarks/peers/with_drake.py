"""Grasps by Drake with SNOPT or IPOPT: positions and forces in one program, as users of Drake write it.

Maximise beta subject to, for each direction j of the task, forces in their exact cones with ``G(p) f_j = beta w_j`` and
``|f_j| <= 1``, and the contacts on the body. Forces stand in the body frame; first derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

import nlpgrasp as ng
from benchmarks.peers.answer import Answer, cpu_seconds
from benchmarks.peers.cases import Case
from benchmarks.peers.epsilon import best_of
from benchmarks.peers.random_search import Placement, start_placement
from benchmarks.peers.surface import FaceFunction, face_functions
from nlpgrasp.common.validation import FloatArray

NAME = "Drake"
SAMPLED, ITERATIONS = 24, 200  # directions beside the semi-axes; major iterations
Values = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the grasp of the largest epsilon over all starts.

    ``budget`` is not used.
    """
    del budget
    solvers = import_module("pydrake.solvers")
    snopt = solvers.SnoptSolver()
    solver = snopt if snopt.available() and snopt.enabled() else solvers.IpoptSolver()
    results = []
    for seed in range(starts):
        start = start_placement(case, seed)
        points = candidate(case, start, np.random.default_rng(seed), solver)
        results.append(Answer(NAME, points, start.faces, cpu_seconds()))
    return [best_of(case, results)]


def candidate(case: Case, start: Placement, rng: np.random.Generator, solver: Any) -> FloatArray:
    """Return the contact points of one solve, (k, 3), metres."""
    solvers = import_module("pydrake.solvers")
    program, k, size = solvers.MathematicalProgram(), case.fingers, case.body.size
    soft = isinstance(case.contacts[0], ng.SoftContact)
    y = rng.standard_normal((SAMPLED, 6))
    task = np.concatenate([np.eye(6), -np.eye(6), y / np.linalg.norm(y, axis=1, keepdims=True)])
    task = task * np.array(case.shape)  # torques over the body's size
    m = len(task)
    p = program.NewContinuousVariables(k, 3, "p")  # over the body's size
    f = program.NewContinuousVariables(m, 4 * k if soft else 3 * k, "f").reshape(m, k, -1)
    beta = program.NewContinuousVariables(1, "beta")
    program.AddLinearCost(-beta[0])
    program.AddBoundingBoxConstraint(0.0, 10.0, beta)
    functions = face_functions(case.body, start.faces)
    for i, function in enumerate(functions):
        cones = _Cones(function, case, m)
        rows = len(cones(np.append(start.points[i] / size, f[:, i].size * [0.0]))[0])
        upper = np.full(rows, np.inf)
        upper[0] = 0.0
        variables = np.concatenate([p[i], f[:, i].ravel()])
        program.AddConstraint(_differentiated(cones), np.zeros(rows), upper, variables)
    center, weights = case.body.centroid / size, np.tile([1.0] * 3 + [size] * soft, k)
    for j in range(m):
        balance = _Balance(functions, center, task[j], np.array(case.shape))
        variables = np.concatenate([p.ravel(), f[j].ravel(), beta])
        program.AddConstraint(_differentiated(balance), np.zeros(6), np.zeros(6), variables)
        square = np.diag(2.0 * weights**2)
        program.AddQuadraticConstraint(square, np.zeros(len(weights)), -np.inf, 1.0, f[j].ravel())
    program.SetInitialGuess(p, start.points / size)
    for i in range(k):
        program.SetInitialGuess(f[:, i, :3], np.tile(0.5 * start.normals[i], (m, 1)))
    if soft:
        program.SetInitialGuess(f[:, :, 3], np.zeros((m, k)))
    program.SetInitialGuess(beta, [0.0])
    options = solvers.SolverOptions()
    options.SetOption(solvers.SnoptSolver().solver_id(), "Major iterations limit", ITERATIONS)
    options.SetOption(solvers.IpoptSolver().solver_id(), "max_iter", ITERATIONS)
    result = solver.Solve(program, None, options)
    return np.asarray(result.GetSolution(p)) * size


class _Cones:
    """Constraints of one contact: on its face, within the face's limits, and all forces in the friction cone."""

    def __init__(self, function: FaceFunction, case: Case, count: int) -> None:
        self._function, self._count = function, count
        coefficients = case.contacts[0].coefficients
        self._slope = 1.0 + coefficients["friction"] ** 2
        self._twist = coefficients.get("torsional_friction", 0.0) / case.body.size

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the constraint values (r,) and their derivatives (r, 3 + m c).

        The first has to be 0, the others at least 0.
        """
        d, n, e, dd, dn, de = self._function.derivatives(x[:3])
        f = x[3:].reshape(self._count, -1)
        force, width = f[:, :3], f.shape[1]
        normal, turned = force @ n, force @ dn
        rows, slopes = [d, -e], [np.pad(dd, ((0, 0), (0, f.size))), np.pad(-de, ((0, 0), (0, f.size)))]
        cone = self._slope * normal**2 - np.sum(force**2, axis=1)
        by_force = 2.0 * self._slope * normal[:, None] * n - 2.0 * force
        terms = [
            (normal, turned, np.tile(n, (self._count, 1))),
            (cone, 2.0 * self._slope * normal[:, None] * turned, by_force),
        ]
        if width == 4:
            for sign in (1.0, -1.0):
                by_component = np.tile(np.append(self._twist * n, sign), (self._count, 1))
                terms.append((self._twist * normal + sign * f[:, 3], self._twist * turned, by_component))
        for value, by_p, by_f in terms:
            slope = np.zeros((self._count, x.size))
            slope[:, :3] = by_p
            for j in range(self._count):
                column = 3 + j * width
                slope[j, column : column + by_f.shape[1]] = by_f[j]
            rows.append(value)
            slopes.append(slope)
        return np.concatenate(rows), np.vstack(slopes)


class _Balance:
    """Wrench balance in one direction of the task: forces add up to beta times the wrench."""

    def __init__(
        self, functions: list[FaceFunction], center: FloatArray, wrench: FloatArray, scale: FloatArray
    ) -> None:
        self._functions, self._center, self._wrench, self._scale = functions, center, wrench, scale

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residual (6,), divided by the task's semi-axes, and its derivatives (6, 3 k + k c + 1)."""
        k = len(self._functions)
        p, f = x[: 3 * k].reshape(k, 3), x[3 * k : -1].reshape(k, -1)
        width = f.shape[1]
        total, slope = -x[-1] * self._wrench, np.zeros((6, x.size))
        slope[:, -1] = -self._wrench
        for i, function in enumerate(self._functions):
            arm, force, column = p[i] - self._center, f[i, :3], 3 * k + width * i
            total = total + np.concatenate([force, np.cross(arm, force)])
            slope[:3, column : column + 3] = np.eye(3)
            slope[3:, column : column + 3] = _cross(arm)
            slope[3:, 3 * i : 3 * i + 3] = -_cross(force)
            if width == 4:
                _, n, _, _, dn, _ = function.derivatives(p[i])
                total[3:] += f[i, 3] * n
                slope[3:, column + 3] = n
                slope[3:, 3 * i : 3 * i + 3] += f[i, 3] * dn
        return total / self._scale, slope / self._scale[:, None]


def _cross(a: FloatArray) -> FloatArray:
    """Return the matrix of the cross product ``b -> a x b``, (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _differentiated(function: Values) -> Callable[[Any], Any]:
    """Return a function for Drake that accepts numbers or AutoDiffXd.

    ``function`` states values and derivatives.
    """
    autodiff = import_module("pydrake.autodiffutils")

    def evaluated(x: Any) -> Any:
        if x.dtype != object:
            return function(x)[0]
        values, slope = function(autodiff.ExtractValue(x).ravel())
        return autodiff.InitializeAutoDiff(values[:, None], slope @ autodiff.ExtractGradient(x)).ravel()

    return evaluated
