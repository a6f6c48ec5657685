"""mu relative to the given task, and the paper's mu: the beta of the largest A_beta (3.3-4a)."""

import copy
import json

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality.wrench_set import WrenchSet
from tests.once import solve_once
from tests.samples import random_rotation

SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GRASP = ng.Grasp([[0, -1], [0, 1], [1, 0.2]], [[0, 1], [0, -1], [-1, 0]], ng.FrictionContact(0.5))
Q = np.diag([1.0, 2.0, 3.0])


@pytest.mark.parametrize("beta", [0.25, 1.0, 2.0, 7.5])
def test_the_paper_s_mu_does_not_depend_on_the_beta_of_the_task_as_given(beta):
    unit, bounds = (
        ng.mu(GRASP, ng.TaskEllipsoid.from_quadratic(Q)),
        ng.mu(GRASP, ng.TaskEllipsoid.from_quadratic(Q, beta=beta)),
    )
    assert (bounds.kind, bounds.beta.kind) == ("mu", "beta")
    assert (bounds.beta.lower, bounds.beta.upper) == (beta * bounds.lower, beta * bounds.upper)
    assert bounds.beta.lower <= unit.upper  # the same number, each within its own interval
    assert unit.lower <= bounds.beta.upper
    # A_beta, {<y, Q y> <= beta^2}, inside the wrench set: no direction whose support is less
    y = np.random.default_rng(0).normal(size=(4000, 3))
    forces = WrenchSet.of(GRASP, "l2").support(y)[0]
    needed = np.sqrt(np.sum(y * np.linalg.solve(Q, y.T).T, axis=1))
    assert np.min(forces / needed) >= bounds.beta.lower
    assert np.min(forces / needed) == pytest.approx(bounds.beta.upper, rel=0.02)


def test_beta_is_scaled_with_the_task_and_kept_by_frames_and_files(rng):
    task = ng.TaskEllipsoid.from_quadratic(Q, beta=2.0)
    pose = np.eye(3)
    pose[:2, :2], pose[:2, 2] = random_rotation(rng, 2), [0.3, -0.1]
    assert (3.0 * task).beta == 6.0
    np.testing.assert_allclose((3.0 * task).axes, ng.TaskEllipsoid.from_quadratic(Q, beta=6.0).axes, rtol=1e-12)
    assert task.in_frame(pose).beta == task.at([0.2, 0.1]).beta == copy.copy(task).beta == 2.0
    assert ng.TaskEllipsoid.from_dict(task.to_dict()) == task
    assert "beta" not in ng.TaskEllipsoid([1.0, 1.0, 1.0]).to_dict()
    assert "beta=2" in repr(task)


def test_a_task_off_the_origin_says_mu_tilde_and_has_no_beta():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, 0.3, 0.0])
    bounds = ng.mu(GRASP, task)
    assert (bounds.kind, bounds.beta) == ("mu_tilde", None)
    assert ng.mu_tilde(GRASP, ng.TaskEllipsoid([1.0, 1.0, 1.0])).kind == "mu_tilde"
    assert ng.delta(GRASP).kind == "delta"
    stack = ng.GraspStack(np.stack([GRASP.points] * 2), np.stack([GRASP.normals] * 2), GRASP.contacts)
    assert ng.mu(stack, task)[1].kind == "mu_tilde"


def test_the_equivalence_constants_are_the_paper_s():
    """(3.3-8): of a centred task both are its beta, as mu is beta times mu-tilde."""
    for beta in (1.0, 2.0, 0.3):
        task = ng.TaskEllipsoid.from_quadratic(Q, beta=beta)
        low, high = ng.equivalence_constants(task)
        assert low == high == beta
        paper, tilde = ng.mu(GRASP, task, rtol=1e-4).beta, ng.mu_tilde(GRASP, task, rtol=1e-4)
        assert low * tilde.lower <= paper.upper
        assert paper.lower <= high * tilde.upper


@pytest.fixture(scope="module")
def doubled():
    task = ng.TaskEllipsoid.from_quadratic(np.eye(3), beta=2.0)
    problem = ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 3, task, name="doubled")
    return solve_once(problem, starts=1, options=ng.SolveOptions(workers=1))


def test_solutions_and_files_state_both(doubled, tmp_path):
    assert (doubled.beta.lower, doubled.beta.upper) == (2.0 * doubled.mu.lower, 2.0 * doubled.mu.upper)
    assert "beta of the paper in [" in str(doubled)
    path = doubled.save(tmp_path / "doubled.json")
    data = json.loads(path.read_text())
    assert data["problem"]["task"]["beta"] == 2.0
    assert data["quality"]["mu"]["beta"]["lower"] == 2.0 * data["quality"]["mu"]["lower"]
    loaded = ng.GraspSolution.load(path)
    assert loaded.beta == doubled.beta
    assert ng.verify(path).passed
    data["quality"]["mu"]["beta"]["upper"] *= 2.0
    path.write_text(json.dumps(data))
    with pytest.raises(ng.InputError, match=r"quality\.mu\.beta: .*mu times the task's beta"):
        ng.GraspSolution.load(path)
