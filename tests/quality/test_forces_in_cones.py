"""Least forces of every contact model under every force budget, against cones written from definitions."""

from itertools import product

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets.registry import BUDGETS, NAMED
from tests.memberships import inside
from tests.quick import every_row
from tests.samples import EVERY

BY_NAME = ["l2", "per_finger", "shared", "per_finger_size"]
BY_TORQUES = ["joint_torques", "shared_joint_torques"]  # hand_torques in a posture is the second of them
BUDGET_KINDS = BY_NAME + BY_TORQUES
MANY = 1000
CONIC = 50  # forces of a rectangle that are checked, each by a conic program


def cube_grasp(name):
    """Return contacts on six sides of a cube of side 0.06, none of them in its middle."""
    points = np.concatenate([np.eye(3), -np.eye(3)]) * 0.03
    offsets = np.random.default_rng(3).uniform(-0.02, 0.02, (6, 3)) * (points == 0.0)
    return ng.Grasp(points + offsets, -points / 0.03, EVERY[name])


def bound_to(budget, grasp):
    """Return the budget; joint torques of three joints a finger (and moments too) with Jacobians at random."""
    if budget in BY_NAME:
        return budget
    rng, k = np.random.default_rng(1), len(grasp)
    if budget == "joint_torques":
        return ng.JointTorqueLimits([rng.standard_normal((6, 6)) for _ in range(k)], 1.0)
    return ng.SharedJointTorqueLimits([rng.standard_normal((6, 8)) for _ in range(k)], 1.0, force_limit=5.0)


def wrenches_for(grasp, count, rng):
    """Return wrenches of all directions, along the axes, of single contacts, and of forces inside the cones."""
    units = np.array([1.0] * 3 + [0.03] * 3)
    axes = np.concatenate([np.eye(6), -np.eye(6)]) * units
    of_contacts = np.concatenate([grasp.G.T[:6], -grasp.G.T[:6]])
    left = count - len(axes) - len(of_contacts)
    half = left // 2 if grasp.contacts[0].coefficients else 10  # most of them out of reach without friction
    x = rng.standard_normal((left - half, grasp.G.shape[1]))
    x = np.concatenate(
        [
            np.where(np.arange(block.shape[1]) == 0, np.abs(block), 0.02 * block)
            for block in np.split(x, len(grasp), axis=1)
        ],
        axis=1,
    )
    return np.concatenate([axes, of_contacts, rng.standard_normal((half, 6)) * units, x @ grasp.G.T])


def check(name, budget, count):
    grasp, rng = cube_grasp(name), np.random.default_rng(0)
    wrenches = wrenches_for(grasp, count, rng)
    assert len(wrenches) == count
    if name == "bilateral" and budget in ("per_finger", "shared", *BY_TORQUES):
        with pytest.raises(ng.InputError, match="bilateral"):
            ng.finger_forces(grasp, wrenches, force_budget=bound_to(budget, grasp))
        return
    result = ng.finger_forces(grasp, wrenches, force_budget=bound_to(budget, grasp))
    contact, x = EVERY[name], result.forces.reshape(count, 6, -1)
    size = np.linalg.norm(x, axis=(1, 2))
    scaled = x / np.where(size > 0.0, size, 1.0)[:, None, None]
    some = rng.integers(0, count, CONIC) if name == "coulomb rectangle" else slice(None)
    assert inside(contact, scaled[some], 1e-9 if name.startswith("coulomb") else 1e-12).all()
    if contact.unilateral:
        assert np.min(x[..., 0]) >= 0.0
    units = np.array([1.0] * 3 + [1.0 / 0.03] * 3)
    errors = np.linalg.norm((result.forces @ grasp.G.T - wrenches) * units, axis=1)
    sizes = np.linalg.norm(wrenches * units, axis=1)
    assert np.max((errors / sizes)[result.feasible]) <= 2e-8
    assert np.sum(result.feasible) >= (count - 24) // 2


def test_every_named_budget_is_tested():
    assert set(BY_NAME) == {name for name, budget in NAMED.items() if not budget.depends_on_frames}
    assert {*BY_NAME, *BY_TORQUES, "hand_torques"} == set(BUDGETS.names)


@pytest.mark.parametrize(("name", "budget"), every_row(3, list(product(EVERY, BUDGET_KINDS))[::5]))
def test_forces_are_in_the_cones(name, budget):
    check(name, budget, 300 if budget == "l2" else 50)


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("budget", BUDGET_KINDS)
def test_forces_of_a_thousand_wrenches_are_in_the_cones(name, budget):
    check(name, budget, MANY)


@pytest.mark.parametrize("model", ["box", "elliptic"])
@pytest.mark.parametrize("budget", BY_NAME)
@pytest.mark.parametrize("arm", [1.0, 0.03])
def test_of_two_opposed_fingers_one_pushes(model, budget, arm):
    """Along the line between them the finger behind the body pushes, and the one in front does not pull."""
    grasp = ng.Grasp([[-arm, 0, 0], [arm, 0, 0]], [[1, 0, 0], [-1, 0, 0]], ng.SoftContact(0.5, 0.02, model=model))
    result = ng.finger_forces(grasp, [1.0, 0, 0, 0, 0, 0], force_budget=budget)
    np.testing.assert_allclose(result.forces, [[1.0, 0, 0, 0, 0, 0, 0, 0]], atol=1e-8)
    assert np.min(result.forces[:, [0, 4]]) >= 0.0
    assert result.used[0] == pytest.approx(1.0, abs=1e-8)
