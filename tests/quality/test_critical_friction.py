"""Least friction and force curve: closed forms, and conic programs beyond either end."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality.force_problem import finger_forces

SIDES = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
INWARD = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
WEIGHT = ng.TaskPolytope([[0, 0, 2.0, 0, 0, 0]])


def pinch(friction: float = 0.6) -> ng.Grasp:
    return ng.Grasp(SIDES, INWARD, ng.FrictionContact(friction))


def test_a_weight_between_four_fingers_needs_its_share() -> None:
    # 2 N on four contacts that press with 2 N each: 0.5 N of friction a contact
    for limits in ({"finger_force": 2.0}, {"total": 8.0}):
        friction = ng.critical_friction(pinch(), WEIGHT, **limits)
        assert friction.lower <= 0.25 <= friction.upper <= 1.02 * friction.lower
    assert ng.critical_friction(pinch(), WEIGHT).lower == 0.0  # with forces of any size


def test_the_force_curve_is_the_weight_over_friction() -> None:
    for friction, force in zip((0.1, 0.5, 2.0), ng.force_curve(pinch(), WEIGHT, (0.1, 0.5, 2.0)), strict=True):
        assert force.lower <= 0.5 / friction <= force.upper <= 1.01 * force.lower


@pytest.mark.parametrize("seed", range(4))
def test_the_task_is_held_above_and_lost_below(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    grasp = ng.Grasp(-0.03 * normals, normals, ng.FrictionContact(0.5))
    wrenches = rng.normal(size=(5, 6)) * [1, 1, 1, 0.02, 0.02, 0.02]
    friction = ng.critical_friction(grasp, ng.TaskPolytope(wrenches), total=40.0)
    if not np.isfinite(friction.upper):
        assert not held(grasp, wrenches, 5.0, 40.0)
        return
    assert held(grasp, wrenches, 1.001 * friction.upper, 40.0)
    assert not held(grasp, wrenches, 0.999 * friction.lower, 40.0)


def held(grasp: ng.Grasp, wrenches: np.ndarray, friction: float, total: float) -> bool:
    """Whether a conic program a wrench finds forces within the limit."""
    other = ng.Grasp(grasp.points, grasp.normals, ng.FrictionContact(friction))
    forces = finger_forces(other, wrenches, force_budget="shared").forces.reshape(len(wrenches), -1, 3)
    sums = np.where(np.isfinite(forces[:, :, 0]), forces[:, :, 0], np.inf).sum(axis=1)
    return bool(np.all(sums <= total))


def test_bad_input_is_refused() -> None:
    with pytest.raises(ng.InputError, match="one of finger_force and total"):
        ng.critical_friction(pinch(), WEIGHT, finger_force=1.0, total=2.0)
    mixed = ng.Grasp(SIDES, INWARD, [ng.FrictionContact(0.5)] * 3 + [ng.FrictionContact(0.6)])
    with pytest.raises(ng.InputError, match="contacts with one friction coefficient"):
        ng.critical_friction(mixed, WEIGHT)
    with pytest.raises(ng.InputError, match="frictions"):
        ng.force_curve(pinch(), WEIGHT, [0.0])
