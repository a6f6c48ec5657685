"""Budgets whose support has kinks: mu in the plane against the convex hull of all wrenches, and true local optima."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import nlpgrasp as ng
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.quality.tight_wrenches import tight_wrenches
from nlpgrasp.quality.wrench_set import WrenchSet

BUDGETS = ["shared", "per_finger"]
UNIT = np.array([1.0, 1.0, 0.03])  # of wrenches
PENTAGON = ng.Polygon(
    [[0.02027, 0.03182], [-0.0342, 0.04354], [-0.03441, -0.0336], [-0.02017, -0.04945], [0.04362, -0.01698]]
)


def mu_by_hull(points, normals, frictions, task, budget):
    """Return mu of a planar grasp from the convex hull of its wrenches."""
    edges = []
    for p, n, friction in zip(points, normals, frictions, strict=True):
        forces = [n + side * friction * np.array([-n[1], n[0]]) for side in (1.0, -1.0)]
        edges.append([np.append(f, p[0] * f[1] - p[1] * f[0]) for f in forces])
    if budget == "shared":
        corners = [np.zeros(3), *(w for pair in edges for w in pair)]
    else:
        corners = [sum(chosen) for chosen in product(*[[np.zeros(3), *pair] for pair in edges])]
    faces = ConvexHull(np.array(corners) / UNIT).equations
    reach = task.support(faces[:, :3] / UNIT)[0]
    return max(0.0, float(np.min(-faces[reach > 0.0, 3] / reach[reach > 0.0])))


def random_grasps(rng, count):
    for _ in range(count):
        angles, k = rng.uniform(0.0, 2.0 * np.pi, 4), int(rng.integers(2, 5))
        points = 0.04 * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:k]
        turned = (angles + rng.normal(0.0, 0.3, 4))[:k]
        yield points, -np.stack([np.cos(turned), np.sin(turned)], axis=1), rng.uniform(0.2, 0.9, k)


@pytest.mark.parametrize("budget", BUDGETS)
def test_screening_gives_mu_itself_in_the_plane(budget, rng):
    held = 0
    for points, normals, frictions in random_grasps(rng, 60):
        task = ng.TaskEllipsoid([1.0, 1.0, 0.02], center=[*rng.normal(0.0, 0.4, 2), 0.0])
        models = [ng.FrictionContact(friction) for friction in frictions]
        stack = ng.GraspStack(points[None], normals[None], models, [0.0, 0.0])
        expected = mu_by_hull(points, normals, frictions, task, budget)
        assert ng.screen(stack, task, force_budget=budget)[0] == pytest.approx(expected, rel=1e-6, abs=1e-9)
        held += expected > 0.0
    assert held >= 5


@pytest.mark.parametrize("budget", ["l2", *BUDGETS])
def test_screening_says_zero_only_where_it_is_with_lines(budget, rng):
    held = 0
    for points, normals, frictions in random_grasps(rng, 80):
        task = ng.TaskEllipsoid([1.0, 1.0, 0.02], center=[*rng.normal(0.0, 0.6, 2), rng.normal(0.0, 0.02)])
        models = [ng.LineContact(length=0.03, friction=friction) for friction in frictions]
        stack = ng.GraspStack(points[None], normals[None], models, [0.0, 0.0])
        lower = ng.mu(stack[0], task, 0.02, force_budget=budget).lower
        assert ng.screen(stack, task, force_budget=budget)[0] >= lower
        held += lower > 0.0
    assert held >= 10


@pytest.mark.parametrize("budget", [*BUDGETS, "per_finger_size"])
def test_forces_at_tight_wrenches_exert_what_the_task_asks_for(budget, rng):
    points = 0.04 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.1], [-0.6, -0.7, 0.2], [0.1, 0.1, 1.0]])
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    grasp = ng.Grasp(points, normals, [ng.FrictionContact(0.6)] * 4, np.zeros(3))
    task = ng.TaskEllipsoid([1.0, 0.7, 1.2, 0.02, 0.03, 0.02])
    problem, _ = make_containment(WrenchSet.of(grasp, budget), task)
    tight = tight_wrenches(problem, random_directions(12, 6, rng))
    assert len(tight) == 12
    exerted = tight.forces @ problem.wrenches.G.T
    np.testing.assert_allclose(exerted, tight.ratios[:, None] * problem.task.support(tight.directions)[1], atol=1e-6)
    np.testing.assert_allclose(problem.wrenches.force_set.gauge(tight.forces), 1.0, atol=1e-9)
    bounds = ng.mu(grasp, task, 1e-3, force_budget=budget)
    assert bounds.lower * (1.0 - 1e-9) <= np.min(tight.ratios) <= bounds.upper * (1.0 + 1e-9)


@pytest.mark.parametrize("budget", BUDGETS)
def test_default_starts_agree_at_a_local_optimum(budget):
    """Once four to eight starts ended between .056 and .0745 under the shared budget."""
    frictions, task = [0.3037, 0.3037], ng.TaskEllipsoid([2.0711, 1.8175, 0.013889])
    problem = ng.GraspProblem(
        PENTAGON,
        [ng.FrictionContact(friction) for friction in frictions],
        task,
        force_budget=budget,
        torque_origin=[0.0, 0.0],
        edge_margin=0.0,
    )
    options = ng.SolveOptions(workers=1, rank="mu", extras=False)
    solutions = [ng.solve(problem, 4, seed, options) for seed in range(3)]
    values = [mu_by_hull(s.grasp.points, s.grasp.normals, frictions, task, budget) for s in solutions]
    assert min(values) > 0.98 * max(values)
    for solution, value in zip(solutions, values, strict=True):
        assert solution.mu.lower * (1.0 - 1e-9) <= value <= solution.mu.upper * (1.0 + 1e-9)
        assert solution.kkt.locally_optimal
        assert ng.verify(solution)
        places = zip(solution.faces, solution.grasp.points, strict=True)
        free = np.array([PENTAGON.edge_distance(face, point[None])[0] > 1e-4 for face, point in places])
        tangents = np.stack([-solution.grasp.normals[:, 1], solution.grasp.normals[:, 0]], axis=1)
        for signs in product((-1.0, 0.0, 1.0), repeat=2):
            moved = solution.grasp.points + 5e-6 * (np.array(signs) * free)[:, None] * tangents
            assert mu_by_hull(moved, solution.grasp.normals, frictions, task, budget) <= (1.0 + 1e-6) * value


@pytest.mark.parametrize("budget", BUDGETS)
def test_the_program_alone_ends_at_the_same_optimum(budget):
    task = ng.TaskEllipsoid([2.0711, 1.8175, 0.013889])
    models = [ng.FrictionContact(0.3037)] * 2
    problem = ng.GraspProblem(PENTAGON, models, task, force_budget=budget, torque_origin=[0.0, 0.0], edge_margin=0.0)
    steps, program = (
        ng.solve(problem, 4, 0, ng.SolveOptions(workers=1, rank="mu", extras=False, method=method))
        for method in ("steps", "program")
    )
    assert program.mu.lower >= 0.99 * steps.mu.lower
    assert program.kkt.locally_optimal
