"""How deep links are in a body, against MuJoCo's distances between geoms."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.solve.surface.link_depth import link_depth
from tests.hands.urdf import FOUR, four_finger_hand

RADIUS = 0.03


def mujoco_depth(hand, values):
    """Return how deep the deepest geom of the hand is in a sphere around the body frame's origin."""
    spec = mujoco.MjSpec.from_file(str(FOUR))
    turn = Rotation.from_quat(values["palm_quaternion"], scalar_first=True).as_matrix()
    centre = -turn.T @ values["palm_position"]  # of the sphere, palm frame
    spec.worldbody.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], pos=centre)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in hand.tree.joint_positions(values["joints"]).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    ball = model.geom("ball").id
    between = np.zeros(6)
    others = [g for g in range(model.ngeom) if g != ball]
    return max(0.0, *(-mujoco.mj_geomDistance(model, data, g, ball, 0.5, between) for g in others))


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 6])  # 4 has the ball's centre in a link, where MuJoCo adds both depths
def test_depth_is_mujocos(seed):
    hand, rng = four_finger_hand(), np.random.default_rng(seed)
    away = rng.uniform(0.0, 0.04) * rng.standard_normal((1, 3))
    values = {name: v[0] for name, v in hand.draw(1, away, rng)[0].items()}
    found = link_depth(ng.Sphere(RADIUS), hand, values)
    expected = mujoco_depth(hand, values)
    assert found.depth == pytest.approx(expected, abs=6e-4)
    assert (found.link is None) == (found.depth == 0.0)


def test_a_hand_far_away_is_not_deep():
    hand = four_finger_hand()
    values = {name: v[0] for name, v in hand.draw(1, np.array([[0.6, 0, 0]]), np.random.default_rng(0))[0].items()}
    found = link_depth(ng.Box([0.05, 0.05, 0.05]), hand, values)
    assert (found.depth, found.link) == (0.0, None)
    assert found.samples > 10_000
