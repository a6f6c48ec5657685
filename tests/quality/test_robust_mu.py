"""Proved robustness: no displaced grasp is below the lower end, and the upper end is of one of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

OFFSET, ANGLE, LOSS = 0.001, 0.09, 0.1
TASK = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Case:
    """Grasp and task, and how far contacts are displaced."""

    grasp: ng.Grasp
    task: ng.TaskEllipsoid
    budget: str
    angle: float

    @classmethod
    def random(cls, seed: int) -> "Case":
        """Return the case of a seed: fingertips, hands and grippers on objects of 4 to 10 cm.

        Fingertips are the best of forty random placements.
        """
        rng = np.random.default_rng(seed)
        half, friction, angle = rng.uniform(0.02, 0.05), float(rng.uniform(0.4, 0.9)), float(rng.uniform(0.05, 0.09))
        budget = ("l2", "shared", "per_finger", "per_finger_size")[seed // 4 % 4]
        arm = half * float(rng.uniform(0.4, 1.0))
        task = (
            ng.TaskEllipsoid([1, 1, 1, arm, arm, arm]),
            ng.TaskEllipsoid([0.5, 0.5, 0.5, 0.5 * arm, 0.5 * arm, 0.5 * arm], center=[0, 0, 1, 0, 0, 0]),
        )[seed // 16 % 2]
        if seed % 4 == 3:
            normals = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0]])[: 3 - seed // 4 % 2]
            points = -half * normals + [0, *rng.uniform(-0.003, 0.003, 2)]
            line = ng.LineContact(0.025, friction, direction=[0, 1, 0])
            pad = ng.PlaneContact(extents=(0.025, 0.015), friction=friction, direction=[0, 1, 0])
            models = [pad, pad] if len(normals) == 2 else [line, line, ng.SoftContact(friction, 0.005)]
            return cls(ng.Grasp(points, normals, models, np.zeros(3)), task, budget, angle)
        model = (
            ng.FrictionContact(friction),
            ng.SoftContact(friction, 0.005),
            ng.SoftContact(friction, 0.004, model="elliptic"),
        )[seed % 4]
        axes, count = half * rng.uniform(0.7, 1.3, 3), (3, 4, 5)[seed // 4 % 3] if seed % 4 else 4
        outward = unit(rng.normal(size=(40, count, 3)))
        stack = ng.GraspStack(axes * outward, -unit(outward / axes), model, np.zeros(3))
        best = int(np.argmax(ng.mu(stack, task, 0.3, force_budget=budget).lower))
        return cls(stack[best], task, budget, angle)

    def robust(self) -> ng.Bounds:
        return ng.robust_mu(self.grasp, self.task, OFFSET, self.angle, LOSS, force_budget=self.budget)

    def displacements(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return random points (m, k, 3) and frames (m, k, 3, 3), mostly as far from the stated ones as allowed."""
        grasp, k = self.grasp, len(self.grasp)
        along = unit(rng.normal(size=(count, k, 2))) * np.minimum(1.0, rng.uniform(0, 3, (count, k, 1)))
        points = grasp.points + OFFSET * np.einsum("mkt,ktx->mkx", along, grasp.tangents)
        turns = unit(rng.normal(size=(count * k, 3))) * np.minimum(1.0, rng.uniform(0, 3, (count * k, 1)))
        rotations = Rotation.from_rotvec(self.angle * turns).as_matrix().reshape(count, k, 3, 3)
        return points, rotations @ grasp.frames

    def displaced(self, points: np.ndarray, frames: np.ndarray) -> ng.Grasp:
        """Return a displaced grasp with the least friction."""
        grasp, tangents = self.grasp, frames[:, :, 1:].transpose(0, 2, 1)
        models = [contact.with_friction(1.0 - LOSS) for contact in grasp.contacts]
        return ng.Grasp(points, frames[:, :, 0], models, grasp.torque_origin, tangents)


FOUR = unit(np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]))
ALONG = [0.3, 0.5, 0.8]
CASES = {
    "friction": (ng.FrictionContact(0.7), "l2"),
    "torsion": (ng.SoftContact(0.7, 0.005), "shared"),
    "elliptic torsion": (ng.SoftContact(0.7, 0.005, model="elliptic"), "per_finger"),
    "torsion and forces of one size": (ng.SoftContact(0.8, 0.005), "per_finger_size"),
    "lines": (ng.LineContact(0.02, 0.7, direction=ALONG), "l2"),
    "lines, box": (ng.LineContact(0.02, 0.7, direction=ALONG, model="box"), "per_finger"),
    "rectangles": (ng.PlaneContact(extents=(0.02, 0.01), friction=0.7, direction=ALONG), "shared"),
    "rectangles, box": (ng.PlaneContact(extents=(0.02, 0.01), friction=0.7, direction=ALONG, model="box"), "l2"),
    "discs": (ng.PlaneContact(radius=0.01, friction=0.7), "per_finger_size"),
}


@pytest.mark.parametrize("name", CASES)
def test_no_displaced_grasp_is_below_the_lower_end(name: str) -> None:
    contact, budget = CASES[name]
    case = Case(ng.Grasp(-0.03 * FOUR, FOUR, contact, np.zeros(3)), TASK, budget, ANGLE)
    robust = case.robust()
    assert 0.7 * robust.upper <= robust.lower
    for points, frames in zip(*case.displacements(8, np.random.default_rng(1)), strict=True):
        assert ng.mu(case.displaced(points, frames), TASK, 0.05, force_budget=budget).upper >= robust.lower


@pytest.mark.parametrize("model", [ng.PlaneContact(radius=0.015), ng.BilateralContact(ng.FrictionContact(0.5))])
def test_forces_that_turn_with_their_contacts(model: ng.PlaneContact | ng.BilateralContact) -> None:
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    points = -0.03 * normals + 0.01 * np.roll(normals, 1, axis=1)
    case = Case(ng.Grasp(points, normals, model, np.zeros(3)), TASK, "l2", 0.01)
    robust = case.robust()
    assert robust.lower > 0.0
    for points, frames in zip(*case.displacements(3, np.random.default_rng(1)), strict=True):
        assert ng.mu(case.displaced(points, frames), TASK, 0.05).upper >= robust.lower


@pytest.mark.parametrize(("seed", "share"), [(1, 0.9), (7, 0.55), (16, 0.8)])
def test_the_claim_is_proved_by_a_checker(seed: int, share: float, tmp_path: Path) -> None:
    case, file = Case.random(seed), tmp_path / "robust.proof"
    robust, limits = case.robust(), (OFFSET, case.angle, LOSS)
    claim = ng.robust_claim(case.grasp, case.task, share * robust.lower, *limits, force_budget=case.budget)
    assert ng.write_proof(*claim, file, 0.05, force_budget=case.budget).lower >= 1.0
    assert ng.check_proof(file).lower >= 1.0
    more = ng.robust_claim(case.grasp, case.task, 1.001 * robust.upper, *limits, force_budget=case.budget)
    assert ng.mu(*more, force_budget=case.budget).lower < 1.0


@pytest.mark.parametrize("angle", [0.09, 0.3, 0.4])
def test_forces_of_the_claim_are_within_cone_and_limit_about_every_normal(angle: float) -> None:
    friction = 0.9
    grasp = ng.Grasp(-0.03 * FOUR, FOUR, ng.FrictionContact(friction), np.zeros(3))
    narrow, _ = ng.robust_claim(grasp, TASK, 0.1, angle=angle, friction_loss=LOSS, force_budget="shared")
    tilts = np.linspace(0.0, angle, 100)[:, None]
    edges = narrow.contacts[0].coefficients["friction"] * np.array([1.0, -1.0])  # of the cone, in the tilt's plane
    normal = narrow.force_unit * (np.cos(tilts) + np.sin(tilts) * edges)
    tangential = narrow.force_unit * (np.cos(tilts) * edges - np.sin(tilts))
    assert np.all(normal <= 1.0)
    assert np.all(np.abs(tangential) <= (1.0 - LOSS) * friction * normal)


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
    assert robust.lower > 0.0 <= worst


def test_bad_input_is_refused() -> None:
    soft = ng.Grasp(-0.03 * FOUR, FOUR, ng.SoftContact(0.5, 0.01))
    with pytest.raises(ng.InputError, match=r"angle.*at most 0\.5"):
        ng.robust_mu(soft, TASK, angle=0.6)
    with pytest.raises(ng.InputError, match=r"friction_loss.*below 1"):
        ng.robust_mu(soft, TASK, friction_loss=1.0)
    with pytest.raises(ng.InputError, match=r"angle.*below the angle of friction"):
        ng.robust_claim(soft, TASK, 0.1, angle=0.45)
