"""Marginal bounds against attained grasps; the picture of a branch and bound."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.global_bound.marginal_bound import MarginalBound
from tests.cli.test_cli import SMALL, run_here

SQUARE = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def box_problem(**more):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04], center=[0.0, 0.0, 0.3, 0.0, 0.0, 0.0])
    return ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.SoftContact(0.6, 0.01)] * 3, task, **more)


def placed(body, rng, count):
    """Points of a box's faces with inward normals."""
    half = body.half_size
    axis, sign = rng.integers(0, 3, count), rng.choice([-1.0, 1.0], count)
    points = rng.uniform(-1, 1, (count, 3)) * half
    points[np.arange(count), axis] = sign * half[axis]
    normals = np.zeros((count, 3))
    normals[np.arange(count), axis] = -sign
    return points, normals


@pytest.mark.slow
@pytest.mark.parametrize(("budget", "power"), [("l2", 2), ("per_finger", 1)])
def test_contacts_add_up_to_no_less_than_mu(budget, power):
    problem, rng = box_problem(force_budget=budget), np.random.default_rng(0)
    worth = MarginalBound.of(problem)
    points, normals = placed(problem.body, rng, 900)
    shares_by_grasp = worth.at(points, normals).reshape(300, 3)
    stack = ng.GraspStack(points.reshape(300, 3, 3), normals.reshape(300, 3, 3), problem.models)
    top = np.argsort(-ng.screen(stack, problem.task, force_budget=budget))[:10]
    for i in top:
        grasp = ng.Grasp(stack.points[i], stack.normals[i], problem.models)
        mu = ng.mu(grasp, problem.task, 1e-3, force_budget=budget)
        assert 0.0 < mu.lower <= np.sum(shares_by_grasp[i]) ** (1 / power)


@pytest.mark.slow
def test_the_largest_worths_are_the_bound_at_the_root():
    """Three contacts at the best place add up to the bound of the one node that a search begins with."""
    problem, rng = box_problem(), np.random.default_rng(1)
    points, normals = placed(problem.body, rng, 20_000)
    most = np.sqrt(3 * np.max(MarginalBound.of(problem).at(points, normals)))
    best = ng.best_possible(problem, gap=0.2, time_limit=None)
    assert most >= best.mu.lower
    assert most <= 4 * best.upper


def test_where_no_contact_may_be_there_is_no_worth():
    problem = box_problem(constraints=[ng.Forbid("+x"), ng.Workspace(ng.BoxRegion([-1, -1, -0.01], [1, 1, 1]))])
    points = np.array([[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0], [0.0, 0.02, -0.015], [0.0, 0.02, 0.015]])
    normals = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, -1.0, 0], [0, -1.0, 0]])
    marginal = MarginalBound.of(problem).at(points, normals)
    assert np.isnan(marginal).tolist() == [True, False, True, False]


def test_worth_is_convex_along_an_edge_and_most_at_its_ends():
    """Along an edge a contact's work is affine, and its square, where it pushes at all, convex."""
    problem = ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0, 1.0]))
    along = np.linspace(-1, 1, 41)
    points = np.stack([along, -np.ones(41)], axis=1)
    marginal = MarginalBound.of(problem).at(points, np.tile([0.0, 1.0], (41, 1)))
    assert np.argmax(marginal) in (0, 40)
    assert np.all(np.diff(marginal, 2) >= -1e-12)


@pytest.mark.slow
def test_the_command_draws_a_search(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "square.py").write_text(SMALL)
    result = run_here("bound", "square.py", "--gap", "0.1", "--picture", "square.png", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "picture written to square.png" in result.stdout
    assert (tmp_path / "square.png").read_bytes().startswith(b"\x89PNG")
    missing = run_here("bound", "square.py", "--picture", "no/square.png", cwd=tmp_path)
    assert missing.returncode == 2
    assert "no/square.png" in missing.stderr
