"""Proved robustness: no displaced grasp is below the lower end, and the upper end is of one of them."""

import numpy as np
import pytest

import nlpgrasp as ng

OFFSET, ANGLE, LOSS = 0.001, 0.09, 0.1
TASK = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


CASES = {
    "friction": (ng.FrictionContact(0.7), "l2"),
    "torsion": (ng.SoftContact(0.7, 0.005), "shared"),
    "elliptic torsion": (ng.SoftContact(0.7, 0.005, model="elliptic"), "per_finger"),
    "torsion and forces of one size": (ng.SoftContact(0.8, 0.005), "per_finger_size"),
}


@pytest.mark.parametrize("name", CASES)
def test_no_displaced_grasp_is_below_the_lower_end(name: str) -> None:
    contact, budget = CASES[name]
    rng = np.random.default_rng(1)
    normals = unit(np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]))
    points = -0.03 * normals
    robust = ng.robust_mu(ng.Grasp(points, normals, contact), TASK, OFFSET, ANGLE, LOSS, force_budget=budget)
    assert 0.7 * robust.upper <= robust.lower
    for _ in range(20):
        moved = unit(np.cross(normals, rng.normal(size=(4, 3)))) * OFFSET * rng.choice([0.0, 1.0], size=(4, 1))
        tilted = np.cos(ANGLE) * normals + np.sin(ANGLE) * unit(np.cross(normals, rng.normal(size=(4, 3))))
        displaced = ng.Grasp(points + moved, tilted, contact.with_friction(1.0 - LOSS))
        assert ng.mu(displaced, TASK, 0.05, force_budget=budget).upper >= robust.lower


def test_without_displacement_it_is_mu() -> None:
    normals = unit(np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]))
    grasp = ng.Grasp(-0.03 * normals, normals, ng.FrictionContact(0.5))
    robust, quality = ng.robust_mu(grasp, TASK, 0.0, 0.0, 0.0), ng.mu(grasp, TASK)
    assert robust.lower <= quality.upper
    assert quality.lower <= robust.upper
    assert robust.upper <= 1.05 * robust.lower


def test_a_planar_grasp_keeps_what_every_displacement_leaves() -> None:
    grasp = ng.Grasp([[-1, 0], [1, 0.1], [0, 1.0]], [[1, 0], [-1, 0], [0, -1.0]], ng.FrictionContact(0.6))
    task = ng.TaskEllipsoid([1, 1, 0.5])
    robust = ng.robust_mu(grasp, task, 0.02)
    worst = min(
        ng.mu(
            ng.Grasp(
                grasp.points + 0.02 * np.array(side)[:, None] * grasp.tangents[:, 0],
                grasp.normals,
                ng.FrictionContact(0.54),
            ),
            task,
        ).upper
        for side in np.ndindex(2, 2, 2)
    )
    assert 0.0 < robust.lower <= worst


def test_bad_input_is_refused() -> None:
    normals = np.array([[1.0, 0, 0], [-1, 0, 0]])
    grasp = ng.Grasp(-0.03 * normals, normals, ng.LineContact(0.02, 0.5, direction=[0, 1, 0]))
    with pytest.raises(ng.InputError, match="contacts at a point"):
        ng.robust_mu(grasp, TASK)
    soft = ng.Grasp(-0.03 * normals, normals, ng.SoftContact(0.5, 0.01))
    with pytest.raises(ng.InputError, match=r"angle.*at most 0\.5"):
        ng.robust_mu(soft, TASK, angle=0.6)
    with pytest.raises(ng.InputError, match=r"friction_loss.*below 1"):
        ng.robust_mu(soft, TASK, friction_loss=1.0)
