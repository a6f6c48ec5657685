"""Contacts of a hand in a given posture."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.interop import grasp_of_posture, isaac_grasp, read_isaac_grasps
from nlpgrasp.interop.hand_postures import nearest_points
from tests.hands.urdf import gripper, three_finger_hand
from tests.once import solve_once

pytestmark = pytest.mark.slow  # a solve with a hand

SCRIPT = """
import nlpgrasp as ng
from tests.hands.urdf import three_finger_hand
from tests.once import solve_once

def problem():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    return ng.GraspProblem(ng.Ellipsoid([0.05, 0.03, 0.03]), ng.SoftContact(0.7, 0.01), task, hand=three_finger_hand())
"""


def problem(body=None, hand=None):
    body = ng.Ellipsoid([0.05, 0.03, 0.03]) if body is None else body
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    hand = three_finger_hand() if hand is None else hand
    return ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=hand)


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """A solution and its isaac_grasp file."""
    solution = solve_once(problem(), starts=2)
    path = tmp_path_factory.mktemp("held") / "held.yaml"
    path.write_text(isaac_grasp({"grasp_0": solution}))
    return solution, path


def test_another_gripper_frame_is_refused(held):
    posture = replace(read_isaac_grasps(held[1])[0], gripper_frame="wrist")
    with pytest.raises(InputError, match="gripper_frame: got wrist, expected 'palm'"):
        grasp_of_posture(problem(), posture)


def test_the_contacts_are_found_again(held):
    solution, path = held
    grasp = grasp_of_posture(problem(), read_isaac_grasps(path)[0])
    np.testing.assert_allclose(grasp.points, solution.grasp.points, atol=1e-6)
    np.testing.assert_allclose(grasp.normals, solution.grasp.normals, atol=1e-4)
    bounds = ng.mu(grasp, problem().task)
    assert bounds.lower <= solution.mu.upper * 1.001
    assert solution.mu.lower <= bounds.upper * 1.001


def test_the_command_certifies_an_isaac_grasp(held, tmp_path):
    solution, path = held
    (tmp_path / "held.py").write_text(SCRIPT)
    command = [sys.executable, "-m", "nlpgrasp", "quality", str(path), "--problem", "held.py"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=120)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("grasp_0: 3 contacts, force budget l2")
    lower = float(re.search(r"certified in \[([\d.]+)", result.stdout)[1])
    assert 0.99 * solution.mu.lower <= lower <= solution.mu.upper


def test_nearest_points_against_brute_force(rng):
    for body in (ng.Box([0.08, 0.04, 0.04]), ng.Ellipsoid([0.05, 0.03, 0.02]), ng.Cylinder(0.03, 0.1)):
        samples = np.concatenate([body.sample(name, 20_000, rng) for name in body.face_names])
        points = body.sample(body.face_names[0], 20, rng)
        points = points + 0.01 * body.evaluate(body.face_names[0], points)[2]
        nearest, normals, distances = nearest_points(body, points)
        brute = np.min(np.linalg.norm(points[:, None] - samples[None], axis=2), axis=1)
        np.testing.assert_allclose(distances, brute, atol=2e-4)
        assert np.all(distances <= brute + 1e-9)
        np.testing.assert_allclose(nearest + distances[:, None] * normals, points, atol=1e-6)


def test_postures_that_do_not_fit_are_refused(held):
    posture = read_isaac_grasps(held[1])[0]
    away = replace(posture, position=posture.position + np.array([0.5, 0.0, 0.0]))
    with pytest.raises(InputError, match="mm from the body, expected two or more within 2 mm"):
        grasp_of_posture(problem(), away)
    joint, *others = posture.joints
    with pytest.raises(InputError, match=f"no position of joint {joint}"):
        grasp_of_posture(problem(), replace(posture, joints=dict.fromkeys(others, 0.0)))
    with pytest.raises(InputError, match="joint elbow, expected the hand's joints"):
        grasp_of_posture(problem(), replace(posture, joints={**posture.joints, "elbow": 0.0}))
    with pytest.raises(InputError, match=r"an ng\.URDFHand"):
        grasp_of_posture(replace(problem(), hand=ng.Fingertips(3)), posture)
    flat = problem(ng.Box([0.05, 0.03, 0.03]), gripper())
    at_rest = replace(posture, joints={joint.name: 0.0 for joint in flat.hand.tree.robot.free_joints})
    with pytest.raises(InputError, match="spherical fingertips"):
        grasp_of_posture(flat, at_rest)
