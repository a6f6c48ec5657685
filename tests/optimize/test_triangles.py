"""Grasps on a mesh itself: refined on triangles, exchanged for places around."""

from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import AROUND, exchange_nearby
from nlpgrasp.optimize.refine import refine_on_body, refine_on_triangles
from nlpgrasp.optimize.start import run_start

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


@cache
def ball():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.03))


@cache
def brick():
    return ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().subdivide().subdivide())


def bench_of(body, **more):
    return CompiledProblem(
        ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, TASK, **more), ng.SolveOptions(workers=1)
    )


def around(compiled, seed):
    """Return a grasp near the corners of a tetrahedron."""
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    some = 0.02 * corners + 0.008 * np.random.default_rng(seed).standard_normal((4, 3))
    cloud = compiled.surface.mesh_cloud
    return GraspCandidate(compiled.problem.body.face_names * 4, cloud.points[cloud.tree.query(some)[1]])


@pytest.mark.parametrize("body", [ball, brick])
def test_contacts_are_on_triangles_with_their_normals_and_off_edges(body):
    compiled = bench_of(body())
    begun = around(compiled, 0)
    found, refined = refine_on_body(compiled, begun, Deadline())
    points, _, off = body().closest(found.grasp.points)
    assert found.is_feasible
    assert np.max(off) <= 1e-9
    np.testing.assert_allclose(body().angles_off_normals(points, -found.grasp.normals), 0.0, atol=1e-6)
    assert np.min(body().edge_distance(body().face_names[0], points)) >= compiled.problem.margin - 1e-6
    begin, normals = body().closest(begun.points)[:2]
    before = ng.mu(compiled.grasp_at(begin, -normals), TASK)
    assert ng.mu(found.grasp, TASK).upper > before.lower
    assert refined.point.value == pytest.approx(ng.mu(found.grasp, TASK, 1e-3).upper, rel=2e-3)


def test_exchanges_nearby_lead_to_other_triangles():
    """On a ball of 1,280 triangles refinement alone stays on those that contacts begin on."""
    compiled = bench_of(ball())
    begun = around(compiled, 1)
    first, refined = refine_on_triangles(compiled, begun, Deadline())
    moved = exchange_nearby(compiled, first.candidate, first.grasp, refined.point.cuts)
    assert np.max(np.linalg.norm(moved.points - first.candidate.points, axis=1)) <= AROUND * ball().size + 1e-9
    both = refine_on_body(compiled, begun, Deadline())[0]
    assert ng.mu(both.grasp, TASK).lower > 1.01 * ng.mu(first.grasp, TASK).upper


@pytest.mark.parametrize("seed", range(2))
def test_a_start_on_a_ball_is_nearly_as_good_as_a_tetrahedron(seed):
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    points, outward, _ = ball().closest(0.03 * corners / np.sqrt(3.0))
    compiled = bench_of(ball())
    found = run_start(compiled, 0, seed, Deadline())
    assert found.record.mu.upper >= 0.98 * ng.mu(compiled.grasp_at(points, -outward), TASK).upper


def test_a_start_does_not_depend_on_those_before():
    first = run_start(bench_of(brick()), 1, 0, Deadline())
    compiled = bench_of(brick())
    run_start(compiled, 0, 0, Deadline())
    np.testing.assert_array_equal(first.found.grasp.points, run_start(compiled, 1, 0, Deadline()).found.grasp.points)
