"""Refinement on the triangles of a mesh, with coordinate exchange over mesh points nearby."""

from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import NEIGHBOURHOOD, exchange_nearby
from nlpgrasp.optimize.refine_on_body import refine_on_body
from nlpgrasp.optimize.start import run_start
from tests.quick import first

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


@cache
def ball():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.03))


@cache
def brick():
    return ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().subdivide().subdivide())


def compiled_problem(body, **more):
    return CompiledProblem(
        ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, TASK, **more), ng.SolveOptions(workers=1)
    )


def around(compiled, seed):
    """Return a grasp near the corners of a tetrahedron."""
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    targets = 0.02 * corners + 0.008 * np.random.default_rng(seed).standard_normal((4, 3))
    cloud = compiled.surface.mesh_cloud
    return GraspCandidate(compiled.problem.body.face_names * 4, cloud.points[cloud.tree.query(targets)[1]])


@pytest.mark.slow
@pytest.mark.parametrize("body", first(1, [brick, ball]))
def test_contacts_are_on_triangles_with_their_normals_and_off_edges(body):
    compiled = compiled_problem(body())
    candidate = around(compiled, 0)
    on_body, result = refine_on_body(compiled, candidate, Deadline())
    points, _, distances = body().closest(on_body.grasp.points)
    assert on_body.is_feasible
    assert np.max(distances) <= 1e-9
    np.testing.assert_allclose(body().angles_off_normals(points, -on_body.grasp.normals), 0.0, atol=1e-6)
    assert np.min(body().edge_distance(body().face_names[0], points)) >= compiled.problem.margin - 1e-6
    initial_points, normals = body().closest(candidate.points)[:2]
    initial_bounds = ng.mu(compiled.grasp_at(initial_points, -normals), TASK)
    assert ng.mu(on_body.grasp, TASK).upper > initial_bounds.lower
    assert result.point.value == pytest.approx(ng.mu(on_body.grasp, TASK, 1e-3).upper, rel=2e-3)


@pytest.mark.slow
def test_exchanges_nearby_lead_to_other_triangles():
    """On a ball of 1,280 triangles refinement alone keeps the contacts on their initial triangles."""
    compiled = compiled_problem(ball())
    first, result = refine_on_body(compiled, around(compiled, 1), Deadline())
    contacts = first.candidate.points
    directions = np.concatenate([result.point.cuts, compiled.sample_tables.directions])
    search, tuples = exchange_nearby(compiled, contacts[None], directions, np.random.default_rng(0))
    moved = search.candidate(tuples[0])
    assert np.max(np.linalg.norm(moved.points[:, None] - contacts, axis=2).min(axis=1)) <= NEIGHBOURHOOD * ball().size
    exchanged = refine_on_body(compiled, moved, Deadline())[0]
    assert ng.mu(exchanged.grasp, TASK).lower > 1.01 * ng.mu(first.grasp, TASK).upper


@pytest.mark.slow
def test_a_start_on_a_ball_is_nearly_as_good_as_a_tetrahedron():
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    points, outward, _ = ball().closest(0.03 * corners / np.sqrt(3.0))
    compiled = compiled_problem(ball())
    start = run_start(compiled, 0, 0, Deadline())
    assert start.record.mu.upper >= 0.98 * ng.mu(compiled.grasp_at(points, -outward), TASK).upper


@pytest.mark.slow
def test_a_start_does_not_depend_on_those_before():
    first = run_start(compiled_problem(brick()), 1, 0, Deadline())
    compiled = compiled_problem(brick())
    run_start(compiled, 0, 0, Deadline())
    np.testing.assert_array_equal(
        first.on_body.grasp.points, run_start(compiled, 1, 0, Deadline()).on_body.grasp.points
    )
