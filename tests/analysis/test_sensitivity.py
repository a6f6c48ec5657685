"""Sensitivity: the least force felt of a wrench of the task's size, against singular values and sampling."""

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from tests.samples import closed_ellipsoid_grasp


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("centre", [0.0, 1.0])
def test_of_an_ellipsoid_it_is_a_singular_value(seed, centre):
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=3 + seed)
    axes = rng.uniform(0.5, 2.0, 6) * [1, 1, 1, 0.03, 0.03, 0.03]
    task = ng.TaskEllipsoid(axes, center=centre * rng.uniform(-1, 1, 6) * axes)
    felt = ng.sensitivity(grasp, task)
    responses = np.linalg.pinv(grasp.G) @ np.diag(axes)
    assert felt.felt == pytest.approx(np.linalg.svd(responses)[1][-1], rel=1e-9)
    assert np.sum((felt.wrench / axes) ** 2) == pytest.approx(1.0)
    assert np.linalg.norm(felt.fingers) == pytest.approx(felt.felt)
    assert felt.share_felt(0.5 * felt.felt) == pytest.approx(0.5)


@pytest.mark.parametrize("seed", range(3))
def test_no_wrench_of_a_polytopes_size_is_felt_less(seed):
    """Wrenches on the boundary of the polytope and its mirror image, by the gauge as a linear program."""
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=4)
    wrenches = rng.standard_normal((7, 6)) * [1, 1, 1, 0.03, 0.03, 0.03]
    felt = ng.sensitivity(grasp, ng.TaskPolytope(np.concatenate([wrenches, -wrenches])))
    forces = np.linalg.pinv(grasp.G)

    def gauge(w):
        return linprog(np.ones(14), A_eq=np.concatenate([wrenches, -wrenches]).T, b_eq=w).fun

    assert gauge(felt.wrench) == pytest.approx(1.0)
    assert np.linalg.norm(forces @ felt.wrench) == pytest.approx(felt.felt)
    for w in rng.standard_normal((200, 7)) @ wrenches:
        assert np.linalg.norm(forces @ w) / gauge(w) >= felt.felt * (1.0 - 1e-9)


def test_every_added_contact_takes_a_part():
    rng = np.random.default_rng(0)
    grasp, task = closed_ellipsoid_grasp(rng, k=7), ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    parts = [ng.Grasp(grasp.points[:k], grasp.normals[:k], grasp.contacts[:k]) for k in range(3, 8)]
    felt = [ng.sensitivity(part, task).felt for part in parts]
    assert np.all(np.diff(felt) < 0.0)


def test_a_wrench_that_no_finger_exerts_is_not_felt():
    pads = ng.Grasp([[0.02, 0, 0], [-0.02, 0, 0]], [[-1.0, 0, 0], [1.0, 0, 0]], ng.FrictionContact(0.6))
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    felt = ng.sensitivity(pads, task)
    assert felt.felt == 0.0
    np.testing.assert_allclose(np.abs(felt.wrench), [0, 0, 0, 0.03, 0, 0], atol=1e-9)  # about the line through both
    assert felt.share_felt(0.1) == np.inf
    about_z = ng.TaskEllipsoid([1, 1, 1, 0, 0, 0.03])
    assert ng.sensitivity(pads, about_z).felt > 0.0


def test_a_task_without_a_size_is_refused():
    grasp = closed_ellipsoid_grasp(np.random.default_rng(0), k=4)
    with pytest.raises(ng.InputError, match="expected a task of more than one wrench"):
        ng.sensitivity(grasp, ng.TaskPolytope([[0, 0, -1.0, 0, 0, 0]]))
    with pytest.raises(ng.InputError, match="grasp: got 3"):
        ng.sensitivity(3, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03]))
