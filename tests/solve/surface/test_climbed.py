"""Uphill on the mesh itself, after the ascent on the smooth surface."""

from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.surface.climbed import climbed
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.surface_samples import MESH_ANGLE
from nlpgrasp.solve.workbench.workbench import Workbench
from tests.quick import first

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
AROUND = np.array([[1.0, 0.0, 0.3], [-0.5, 0.87, 0.3], [-0.5, -0.87, 0.3], [0.0, 0.2, 1.3]])


@cache
def ball():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.03))


@cache
def brick():
    return ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().subdivide().subdivide())


def bench_of(body, **posed):
    models = [ng.FrictionContact(0.6)] * 4
    return Workbench(ng.GraspProblem(body, models, TASK, **posed), ng.SolveOptions(workers=1))


def drawn(bench, seed):
    """Return a grasp at random points of the mesh, and where it is."""
    cloud = bench.surface.mesh_cloud
    some = np.random.default_rng(seed).integers(len(cloud.points), size=4)
    placed = Placed(bench.problem.body.face_names * 4, cloud.points[some])
    return placed, bench.grasp_at(cloud.points[some], cloud.normals[some])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_from_anywhere_on_a_ball_to_the_best(seed):
    """As good, within 3 %, as from a regular tetrahedron's corners."""
    bench = bench_of(ball())
    placed, start = drawn(bench, seed)
    found = climbed(bench, placed, start, np.random.default_rng(0), Stop())
    assert np.max(ball().closest(found.points)[2]) <= 1e-9
    best = climbed(bench, placed, bench.grasp_at(*ideal()), np.random.default_rng(0), Stop())
    assert ng.mu(found, TASK).upper >= 0.97 * ng.mu(best, TASK).lower


def ideal():
    """Return the corners of a tetrahedron on the mesh with the mesh's own inward normals."""
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    points, outward, _ = ball().closest(0.03 * corners / np.sqrt(3.0))
    return points, -outward


@pytest.mark.slow
def test_a_climb_does_not_depend_on_those_before():
    """Starts share the workbench: which of them ran before must not matter."""
    bench = bench_of(brick())
    (placed, start), other = drawn(bench, 1), drawn(bench, 2)
    first = climbed(bench, placed, start, np.random.default_rng(0), Stop())
    climbed(bench, *other, np.random.default_rng(0), Stop())
    again = climbed(bench, placed, start, np.random.default_rng(0), Stop())
    np.testing.assert_array_equal(first.points, again.points)


@pytest.mark.parametrize("budget", first(1, ["l2", "per_finger", "shared"]))
def test_it_is_never_worse_and_stays_off_edges(budget):
    bench = bench_of(brick(), force_budget=budget)
    problem = bench.problem
    gains = []
    for seed in range(3):
        placed, start = drawn(bench, seed)
        found = climbed(bench, placed, start, np.random.default_rng(0), Stop())
        before, after = (ng.mu(g, TASK, 0.01, force_budget=problem.budget) for g in (start, found))
        assert after.upper >= before.lower
        gains.append(after.lower - before.upper)
        assert np.max(brick().closest(found.points)[2]) <= 1e-9
        smooth = brick().evaluate(brick().face_names[0], found.points)[2]
        assert np.min(np.sum(smooth * -found.normals, axis=1)) >= np.cos(MESH_ANGLE) - 1e-9
    assert max(gains) > 0.05


@pytest.mark.parametrize(
    "constraint", [ng.Table(0.0, 0.0), ng.Spread(0.02)], ids=["of single contacts", "that couples contacts"]
)
def test_constraints_are_kept(constraint):
    bench = bench_of(ball(), constraints=[constraint])
    points, outward, _ = ball().closest(0.03 * AROUND / np.linalg.norm(AROUND, axis=1, keepdims=True))
    start, placed = bench.grasp_at(points, -outward), Placed(ball().face_names * 4, points)
    assert bench.violation(placed) <= 1e-5
    found = climbed(bench, placed, start, np.random.default_rng(0), Stop())
    after = bench.rows.violations(found.points[None], found.normals[None], placed.repeated_hand(1))
    assert np.max(after) <= 1e-5
    assert ng.mu(found, TASK).lower >= ng.mu(start, TASK).lower


def test_only_on_meshes_and_where_supports_add_up():
    assert bench_of(ball()).mesh_climb is not None
    assert bench_of(ng.Sphere(0.03)).mesh_climb is None
    line = ng.GraspProblem(ball(), [ng.LineContact(0.01, direction=[0.0, 0.0, 1.0])] * 4, TASK)
    assert Workbench(line, ng.SolveOptions(workers=1)).mesh_climb is None
