"""Creep of a held object under gravity in exported scenes."""

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.interop.registry import formats
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions, mjcf_with_hand
from tests.hands.urdf import three_finger_hand
from tests.once import GRASP, solve_once

HAND = "problems/hands/three_finger_hand.urdf"
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
EARTH, A_MINUTE = 9.81, 2e-4 / 60.0  # m / s^2; metres per second that an object may creep


@pytest.fixture(scope="module")
def by_hand():
    """Scene of a grasp by a hand with links, of an object of 100 g."""
    body = ng.Ellipsoid([0.05, 0.03, 0.03])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), TASK, hand=three_finger_hand(), name="a <hand> & more")
    return mjcf_with_hand(solve_once(problem, starts=1, options=GRASP), HAND, HandSceneOptions(mass=0.1))


@pytest.fixture(scope="module")
def by_jaws():
    """Scene of a grasp by parallel jaws, of an object with the density of water."""
    body = ng.Box([0.06, 0.04, 0.01])
    problem = ng.GraspProblem(body, ng.SoftContact(0.6, 0.005), TASK, hand=ng.ParallelJaw(0.08), name="flat")
    mujoco_scene = next(export_format for export_format in formats() if export_format.name == "mjcf")
    return mujoco_scene.export(solve_once(problem, starts=2, options=GRASP)).decode()


def creep(scene, key, seconds, settle=2.0):
    """Return how far an object moves in the world, metres, once gravity has been on for some time."""
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    steps = round(1.0 / model.opt.timestep)

    def run(time):
        for _ in range(round(time * steps)):
            mujoco.mj_step(model, data)
        return np.array(data.body("object").xipos)

    run(1.0)
    for share in np.arange(1, steps + 1) / steps:
        model.opt.gravity[2] = -share * EARTH
        mujoco.mj_step(model, data)
    start = run(settle)
    return float(np.linalg.norm(run(seconds) - start))


def test_an_object_in_a_hand_stays(by_hand):
    assert creep(by_hand, "squeeze", 3.0) <= 3.0 * A_MINUTE


@pytest.mark.slow
def test_an_object_between_jaws_stays(by_jaws):
    assert creep(by_jaws, "grasp", 1.0, settle=0.5) <= 1.0 * A_MINUTE


@pytest.mark.slow
def test_scenes_say_what_keeps_it_there(by_hand, by_jaws):
    for scene in (by_hand, by_jaws):
        assert 'noslip_iterations="10"' in scene
        assert "settled, under 0.2 mm a minute" in scene


@pytest.mark.slow
def test_it_stays_for_a_minute(by_hand, by_jaws):
    assert creep(by_hand, "squeeze", 60.0) <= 2e-4
    assert creep(by_jaws, "grasp", 60.0) <= 2e-4
