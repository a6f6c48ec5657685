"""Tests of the global bound against known optima, random placements and invalid input."""

import copy

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.errors import NotCoveredError
from nlpgrasp.global_bound.scope import scope_of
from nlpgrasp.optimize.global_search import missing_bound_reason, root_branch_and_bound
from tests.quick import first
from tests.studies.random_paths import random_path

SQUARE = [[-1, -1], [1, -1], [1, 1], [-1, 1]]


def square(contacts, budget="l2", **more):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0])
    return ng.GraspProblem(
        ng.Polygon(SQUARE), [ng.FrictionContact(0.5)] * contacts, task, force_budget=budget, edge_margin=0.0, **more
    )


@pytest.mark.parametrize(("contacts", "known"), [(2, 0.44721), pytest.param(3, 0.71556, marks=pytest.mark.slow)])
def test_a_square_in_the_plane(contacts, known):
    best = ng.best_possible(square(contacts), gap=0.005, time_limit=None)
    assert best.closed
    assert best.gap <= 0.005
    assert best.mu.lower <= known * (1 + 1e-4)
    assert known * (1 - 1e-4) <= best.upper <= known * 1.0055
    assert ng.mu(best.grasp, ng.TaskEllipsoid([1.0, 1.0, 1.0]), 1e-3).upper >= best.mu.lower


@pytest.mark.parametrize("budget", first(1, ["l2", "per_finger", "per_finger_size", "shared"]))
def test_no_placement_is_above_the_bound(budget):
    problem = square(2, budget)
    best = ng.best_possible(problem, gap=0.05, time_limit=None if budget != "shared" else 5.0)
    rng = np.random.default_rng(0)
    edges, where = rng.integers(0, 4, (400, 2)), rng.uniform(-1, 1, (400, 2, 1))
    corners = np.array(SQUARE, dtype=float)
    along = np.roll(corners, -1, axis=0) - corners
    points = corners[edges] + 0.5 * (1 + where) * along[edges]
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)[edges] / 2.0
    found = ng.screen(ng.GraspStack(points, inward, problem.models), problem.task, force_budget=budget)
    top = int(np.argmax(found))
    grasp = ng.Grasp(points[top], inward[top], problem.models)
    assert 0.0 < ng.mu(grasp, problem.task, 1e-3, force_budget=budget).lower <= best.upper


@pytest.mark.slow
def test_a_gap_is_closed_though_a_grasp_seemed_better_than_it_is():
    """Nodes are closed by certified quality, not by the estimate of mu."""
    triangle = ng.Polygon([[-1.0, -0.6], [1.0, -0.6], [0.3, 0.9]])
    problem = ng.GraspProblem(triangle, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0] * 3))
    assert ng.best_possible(problem, gap=0.01, time_limit=None).closed


@pytest.mark.slow
def test_directions_that_certificates_find_are_learned():
    """Weak directions of certificates are learned, which descents miss in a narrow cone."""
    problem = random_path(13).at(3.0 / 7.0)
    best = ng.best_possible(problem, gap=0.01, time_limit=None)
    found = ng.mu(best.grasp, problem.task, rtol=1e-3)
    assert best.closed
    assert found.lower > 0.95
    assert best.mu.lower <= found.upper


@pytest.mark.slow
def test_constraints_of_one_contact_shrink_the_bound():
    free = ng.best_possible(square(2), gap=0.02, time_limit=None)
    kept = [ng.Table(-0.9), ng.Forbid("edge2"), ng.Workspace(ng.BoxRegion([-2, -2], [2, 0.2]))]
    held = ng.best_possible(square(2, constraints=kept), gap=0.02, time_limit=None)
    assert held.mu.lower <= free.upper
    assert held.dropped == ()
    assert np.all(held.grasp.points[:, 1] >= -0.9 + 5e-4 - 1e-9)
    assert np.all(held.grasp.points[:, 1] <= 0.2 + 1e-9)


def test_what_is_left_out_is_named():
    problem = square(3, constraints=[ng.Spread(0.5)], hand=ng.Fingertips(3, 0.05, reach=1.5))
    best = ng.best_possible(problem, gap=0.05, time_limit=None)
    assert best.dropped == ("the hand (fingertips)", "spread")
    assert "without the hand (fingertips), spread" in str(best)


@pytest.mark.slow
def test_an_easy_grasp_that_starts_used_to_miss():
    task = ng.lift([0, 0, 0], 0.3) + ng.disturbance(1, 0.01)
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, task)
    best = ng.best_possible(problem, gap=0.1, time_limit=None)
    assert 0.25 < best.mu.lower < 0.275 < best.upper < 0.31


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "roots"),
    [
        (ng.Cylinder(1.0, 2.0), [3] * 4),
        (ng.Prism(2 * np.array(SQUARE), 2.0), [1] * 4),
    ],
)
def test_contacts_that_all_differ_begin_with_few_nodes(body, roots):
    """Root cells are united where one per part of each face gives 160,000 and 1,296 root nodes."""
    contacts = [ng.FrictionContact(0.1 * i) for i in range(5, 9)]
    problem = ng.GraspProblem(body, contacts, ng.TaskEllipsoid(np.linspace(0.5, 1.0, 6), center=0.1 * np.ones(6)))
    assert [len(group.roots) for group in scope_of(problem).contact_cells] == roots
    best = ng.best_possible(problem, gap=0.1, time_limit=5.0)
    assert 0.0 < best.mu.lower <= best.upper
    for face, point in zip(best.faces, best.grasp.points, strict=True):
        h, _, _, extent = body.evaluate(face, point[None])
        assert abs(h[0]) < 1e-9
        assert extent[0] < 1e-9


@pytest.mark.slow
def test_a_box_as_a_mesh():
    known = 0.6992  # of the box itself, closed to 0.1 %
    box = ng.Mesh(trimesh.creation.box([2, 1, 1]), resolution=8)
    problem = ng.GraspProblem(box, [ng.FrictionContact(0.5)] * 4, ng.TaskEllipsoid([1.0] * 6))
    best = ng.best_possible(problem, gap=0.6, time_limit=None)
    assert best.closed
    assert best.mu.lower <= known * 1.001 <= best.upper * 1.002
    assert best.gap <= 0.6
    assert np.allclose(box.closest(best.grasp.points)[2], 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gap": 0.0}, "gap: got 0.0, expected a share above 0, at most 1"),
        ({"gap": -1.0}, "gap: got -1.0, expected a share above 0, at most 1"),
        ({"gap": 1.5}, "gap: got 1.5, expected a share above 0, at most 1"),
        ({"time_limit": 0.0}, "time_limit: got 0.0, expected a number greater than 0"),
    ],
)
def test_arguments_out_of_range(arguments, message):
    with pytest.raises(ng.InputError) as error:
        ng.best_possible(square(2), **arguments)
    assert str(error.value).startswith(message)


def test_problems_that_are_not_covered():
    with pytest.raises(ng.InputError, match="a GraspProblem"):
        ng.best_possible("box")
    implicit = ng.PlanarImplicit(lambda p: p[0] ** 2 + p[1] ** 2 - 1, [[-2, -2], [2, 2]])
    problem = ng.GraspProblem(implicit, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0, 1.0]))
    with pytest.raises(NotCoveredError, match=r"best_possible.body") as error:
        ng.best_possible(problem)
    assert isinstance(copy.copy(error.value), NotCoveredError)
    assert root_branch_and_bound(problem, ng.SolveOptions()) is None
    assert "best_possible.body: planar_implicit" in missing_bound_reason(problem)


class RejectingTask(ng.TaskEllipsoid):
    """Task whose support function rejects its own data."""

    def support(self, y):
        raise ng.InputError("task", "a damaged file", "wrenches")


def test_an_error_of_the_input_is_not_a_problem_without_a_bound():
    problem = square(2).unchecked(task=RejectingTask([1.0, 1.0, 1.0]))
    with pytest.raises(ng.InputError, match="a damaged file") as error:
        root_branch_and_bound(problem, ng.SolveOptions())
    assert not isinstance(error.value, NotCoveredError)
