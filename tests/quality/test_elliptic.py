"""Certificates of grasps with elliptic soft fingers, against an independent conic program."""

import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng
from tests.quick import first
from tests.samples import closed_ellipsoid_grasp

FRICTION, TORSION = 0.6, 0.2
BUDGETS = ["l2", "per_finger", "shared", "per_finger_size"]


def soft_grasp(seed, k=3):
    """Return force-closed soft fingers on an ellipsoid, at random."""
    rng = np.random.default_rng(seed)
    points = closed_ellipsoid_grasp(rng, k)
    return ng.Grasp(points.points, points.normals, ng.SoftContact(FRICTION, TORSION, model="elliptic"))


class Conic:
    """Forces ``x`` of elliptic soft fingers within a budget, and one number more, as rows for Clarabel."""

    def __init__(self, grasp, budget):
        self.G, k = grasp.G, len(grasp)
        n = 4 * k
        unit = np.eye(n + 1)
        rows, tops, self.cones = [], [], []

        def add(cone, matrix, top):  # top - (-matrix) x in the cone
            rows.append(np.atleast_2d(-matrix))
            tops.append(np.broadcast_to(top, len(rows[-1])))
            self.cones.append(cone(len(rows[-1])))

        for i in range(k):
            weights = np.array([1.0, 1 / FRICTION, 1 / FRICTION, 1 / TORSION])[:, None]
            add(clarabel.NonnegativeConeT, unit[4 * i], 0.0)
            add(clarabel.SecondOrderConeT, weights * unit[4 * i : 4 * i + 4], 0.0)
        normals = unit[[4 * i for i in range(k)]]
        if budget == "l2":
            add(clarabel.SecondOrderConeT, np.concatenate([0 * unit[:1], unit[:n]]), np.eye(n + 1)[0])
        elif budget == "per_finger":
            add(clarabel.NonnegativeConeT, -normals, 1.0)
        elif budget == "shared":
            add(clarabel.NonnegativeConeT, -normals.sum(axis=0), 1.0)
        else:
            for i in range(k):
                block = np.concatenate([0 * unit[:1], unit[4 * i : 4 * i + 4]])
                add(clarabel.SecondOrderConeT, block, np.eye(5)[0])
        self.A, self.b, self.n = np.concatenate(rows), np.concatenate(tops), n

    def _solve(self, cost, A, b, cones):
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        no_cost = sparse.csc_matrix((len(cost), len(cost)))
        for settings.max_step_fraction in (0.99, 0.9, 0.7):  # the long steps get stuck on some processors
            solution = clarabel.DefaultSolver(no_cost, cost, sparse.csc_matrix(A), b, cones, settings).solve()
            if str(solution.status) in ("Solved", "AlmostSolved"):
                return -solution.obj_val
        raise AssertionError(solution.status)

    def reach(self, w):
        """Return the largest lambda with ``lambda w`` in the wrench set."""
        equal = np.concatenate([self.G, -w[:, None]], axis=1)
        A, b = np.concatenate([equal, self.A]), np.concatenate([np.zeros(6), self.b])
        return self._solve(-np.eye(self.n + 1)[-1], A, b, [clarabel.ZeroConeT(6), *self.cones])

    def support(self, y):
        """Return the most that a wrench of the set does along y."""
        return self._solve(np.append(-self.G.T @ y, 0.0), self.A, self.b, self.cones)


@pytest.mark.parametrize("budget", BUDGETS)
def test_least_forces_and_the_reach_of_the_wrench_set(budget):
    """The force that a wrench takes is one over how far the set reaches along it; a pull is no way to save any."""
    grasp = soft_grasp(0)
    conic = Conic(grasp, budget)
    wrenches = np.concatenate([np.eye(6), -np.eye(6), np.random.default_rng(1).standard_normal((20, 6))])
    forces = ng.finger_forces(grasp, wrenches, force_budget=budget)
    assert forces.feasible.all()
    np.testing.assert_allclose(1.0 / forces.used, [conic.reach(w) for w in wrenches], rtol=2e-7)


@pytest.mark.parametrize("seed", first(1, range(2)))
@pytest.mark.parametrize("budget", BUDGETS)
def test_a_certified_interval_contains_the_truth(budget, seed):
    """A flat task has a boundary one can walk along: mu is how far the set reaches along the worst of its wrenches."""
    rng = np.random.default_rng(seed)
    grasp = soft_grasp(seed, 3 + seed % 2)
    directions = np.linalg.qr(rng.standard_normal((6, 2)))[0].T
    task = ng.TaskEllipsoid([1.0, 0.4], directions=directions)
    bounds = ng.mu(grasp, task, rtol=1e-3, force_budget=budget)
    conic = Conic(grasp, budget)

    def reach(angle):
        return conic.reach(np.array([np.cos(angle), np.sin(angle)]) @ task.axes)

    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    values = np.array([reach(a) for a in angles])
    middle, step = angles[np.argmin(values)], angles[1]
    for _ in range(4):  # closer, around the least
        near = middle + np.linspace(-step, step, 9)
        around = np.array([reach(a) for a in near])
        middle, step = near[np.argmin(around)], step / 4.0
    truth = min(values.min(), around.min())
    assert bounds.gap <= 1e-3
    assert bounds.lower <= truth * (1 + 1e-8)
    assert truth <= bounds.upper * (1 + 1e-4)


@pytest.mark.parametrize("seed", first(1, range(2)))
@pytest.mark.parametrize("budget", BUDGETS)
def test_no_wrench_and_no_direction_contradicts_a_certificate(budget, seed):
    """Of a full ellipsoid: the worst direction attains the upper bound; every wrench is within the lower."""
    grasp = soft_grasp(seed)
    task = ng.TaskEllipsoid([1.0, 1.0, 2.0, 0.3, 0.3, 0.3])
    bounds, conic = ng.mu(grasp, task, rtol=0.02, force_budget=budget), Conic(grasp, budget)
    y = bounds.worst_direction
    assert conic.support(y) / np.linalg.norm(task.axes @ y) == pytest.approx(bounds.upper, rel=1e-6)
    worst = task.support(y[None])[1][0]
    assert bounds.lower <= conic.reach(worst) * (1 + 1e-8)
    u = np.random.default_rng(seed).standard_normal((30, 6))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    assert bounds.lower <= min(conic.reach(v @ task.axes) for v in u)
    dense = np.random.default_rng(seed).standard_normal((100, 6))
    ratio = [conic.support(v) / np.linalg.norm(task.axes @ v) for v in dense]
    assert bounds.lower <= min(ratio)
