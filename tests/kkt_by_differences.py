"""KKT residual of a solution by central differences in numpy: no derivative and no multiplier of the package's own.

The weighted support ratios along the directions that a solution states are differentiated by differences, and so are
the surfaces, the constraints and the hand; the multipliers are those that leave least of the gradient.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

import nlpgrasp as ng
from nlpgrasp.hands.base import PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_programs import budget_at
from nlpgrasp.optimize.constraint_values import ConstraintValues
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet

STEP = 1e-7  # of each variable's size: second derivatives jump where a force is at the edge of its cone
AT = 1e-5  # relative: a limit farther away has no multiplier; the products of nearer ones with theirs are residuals
SHARP = np.radians(30.0)  # turn of a sharp edge


@dataclass(frozen=True)
class Residual:
    """What is left of the gradient, and the largest product of a multiplier and its slack, relative to mu."""

    stationarity: float
    complementarity: float


def kkt_by_differences(problem, solution):
    """Return the residuals of a solution of a problem that was solved with ``joint_margin=0``."""
    state = _State(problem, solution)
    y, weights = np.array(solution.kkt.directions), np.array(solution.kkt.weights)
    ratios = state.ratios(state.start, y)
    mu = float(weights @ ratios)
    gradient = _differences(lambda v: weights @ state.ratios(v, y)[:, None], state.start)[0]
    limits = state.limits(state.start)
    equal = _differences(state.equations, state.start)
    active = np.abs(limits) <= AT
    binding = _differences(state.limits, state.start)[active]
    lower, upper = state.bounds()
    at_lower, at_upper = state.start <= lower + AT, state.start >= upper - AT
    bounds = np.concatenate([-np.eye(len(state.start))[at_lower], np.eye(len(state.start))[at_upper]])
    slack = np.concatenate([limits[active], (lower - state.start)[at_lower], (state.start - upper)[at_upper]])
    unequal = [weights * (ratios - mu)]
    columns = np.concatenate([equal, binding, bounds]).T
    least = np.concatenate([np.full(len(equal), -np.inf), np.zeros(len(binding) + len(bounds))])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    left = gradient
    if columns.shape[1]:
        found = lsq_linear(columns / size, gradient, (least, np.inf), tol=1e-15, method="bvls", max_iter=2000)
        left = gradient - columns / size @ found.x
        unequal.append((found.x / size)[len(equal) :] * slack)
    return Residual(*(float(np.max(np.abs(part))) / mu for part in (left, np.concatenate(unequal))))


class _State:
    """Contacts and hand as one vector: positions over the body's size, then the hand's variables over their scales."""

    def __init__(self, problem, solution):
        self.problem, self.body, self.k = problem, problem.body, len(problem.models)
        self.faces, self.normals = solution.faces, solution.grasp.normals
        self.rows = ConstraintValues(problem)
        hand = problem.hand
        self.posed = isinstance(hand, PosedHand)
        values = hand.values_of(solution.hand) if self.posed else {}
        self.variables = hand.variables(self.body.bounds) if hand is not None else ()
        own = [np.ravel(values[v.name]) / v.scale for v in self.variables]
        self.start = np.concatenate([solution.grasp.points.ravel() / self.body.size, *own])
        self.on_mesh = isinstance(self.body, ng.Mesh)
        if self.on_mesh:
            self.triangles = self._triangles(solution.grasp)
            self.sharp = [self._sharp_near(p) for p in solution.grasp.points]

    def candidate(self, v):
        """Return contacts and hand."""
        count = self.k * self.body.space
        points, rest, hand = v[:count].reshape(self.k, -1) * self.body.size, v[count:], {}
        for variable in self.variables:
            size = len(variable.lower)
            hand[variable.name], rest = rest[:size] * variable.scale, rest[size:]
        return GraspCandidate(self.faces, points, hand)

    def inward(self, points):
        """Return the inward normals: of analytic bodies at the points, of a mesh those of the triangles."""
        if self.on_mesh:
            return self.normals
        return np.stack([-self.body.evaluate(f, p[None])[2][0] for f, p in zip(self.faces, points, strict=True)])

    def ratios(self, v, y):
        """Return the support ratios along directions, (m,)."""
        candidate = self.candidate(v)
        grasp = Grasp(candidate.points, self.inward(candidate.points), self.problem.models, self.problem.origin)
        return WrenchSet.of(grasp, budget_at(self.problem, candidate)).support(y)[0] / self.problem.task.support(y)[0]

    def equations(self, v):
        """Return what is zero: surfaces and those rows whose limits are equal."""
        candidate = self.candidate(v)
        if self.on_mesh:
            h = [np.dot(n, p - c[0]) for n, p, c in zip(self.normals, candidate.points, self.triangles, strict=True)]
        else:
            each = zip(self.faces, candidate.points, strict=True)
            h = [self.body.evaluate(f, p[None])[0][0] / self.body.evaluate(f, p[None])[1][0] for f, p in each]
        rows = [
            (value - row.lower) / row.scale
            for row, value in zip(self.rows.named, self._row_values(candidate), strict=True)
            if row.lower == row.upper
        ]
        return np.concatenate([np.array(h) / self.body.size, rows])

    def limits(self, v):
        """Return what is at most zero: rows, extents of faces, edges of triangles, the margin from sharp edges."""
        candidate, result = self.candidate(v), []
        for row, value in zip(self.rows.named, self._row_values(candidate), strict=True):
            if row.lower < row.upper:
                result += [(row.lower - value) / row.scale] if np.isfinite(row.lower) else []
                result += [(value - row.upper) / row.scale] if np.isfinite(row.upper) else []
        for i, (face, p) in enumerate(zip(self.faces, candidate.points, strict=True)):
            if self.on_mesh:
                corners, outward = self.triangles[i], -self.normals[i]
                for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                    away = np.cross(b - a, outward)
                    result.append(np.dot(away / np.linalg.norm(away), p - a) / self.body.size)
                for a, b in self.sharp[i]:
                    along = np.clip(np.dot(p - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0)
                    result.append((self.problem.margin - np.linalg.norm(p - a - along * (b - a))) / self.body.size)
            else:
                limits = self.body.surface_function(face, self.problem.margin)(p)[3].full().ravel()
                result += (limits / self.body.size).tolist()
        return np.array(result)

    def bounds(self):
        """Return lower and upper bounds of the state."""
        lower, upper = np.full(len(self.start), -np.inf), np.full(len(self.start), np.inf)
        begin = self.k * self.body.space
        for variable in self.variables:
            part = slice(begin, begin + len(variable.lower))
            lower[part], upper[part] = variable.lower / variable.scale, variable.upper / variable.scale
            begin = part.stop
        return lower, upper

    def _row_values(self, candidate):
        normals = self.inward(candidate.points)
        return self.rows.values(candidate.points[None], normals[None], candidate.repeated_hand(1))[0]

    def _sharp_near(self, point):
        """Return the ends of the edges within the margin, and a little more, of a point at which the mesh turns."""
        mesh = self.body.mesh
        ends = np.asarray(mesh.vertices)[np.asarray(mesh.face_adjacency_edges)[mesh.face_adjacency_angles > SHARP]]
        along = ends[:, 1] - ends[:, 0]
        share = np.clip(np.sum((point - ends[:, 0]) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        far = np.linalg.norm(point - ends[:, 0] - share[:, None] * along, axis=1)
        return ends[far <= self.problem.margin + 1e-3 * self.body.size] if self.problem.margin > 0.0 else []

    def _triangles(self, grasp):
        """Return the corners of the triangles that contacts are on and whose normals they have, (k, 3, 3)."""
        corners = np.asarray(self.body.mesh.triangles)
        outward = np.asarray(self.body.mesh.face_normals)
        found = []
        for p, n in zip(grasp.points, grasp.normals, strict=True):
            same = np.flatnonzero(outward @ -n > 1.0 - 1e-9)
            flat = np.abs(np.sum(outward[same] * (p - corners[same, 0]), axis=1)) < 1e-7 * self.body.size
            edges = np.roll(corners[same], -1, axis=1) - corners[same]
            away = np.cross(edges, outward[same][:, None])
            away /= np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-300)
            beyond = np.max(np.sum(away * (p - corners[same]), axis=2), axis=1)
            found.append(corners[same[np.argmin(np.where(flat, beyond, np.inf))]])
        return np.array(found)


def _differences(function, v):
    """Return the Jacobian of a function at v by central differences."""
    columns = [(function(v + STEP * e) - function(v - STEP * e)) / (2.0 * STEP) for e in np.eye(len(v))]
    return np.stack(columns, axis=-1)
