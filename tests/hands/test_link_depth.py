"""Penetration depth of links against MuJoCo's distances between geoms."""

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.motion.link_parts import LinkParts
from nlpgrasp.motion.penetration import PenetrationModel
from tests.hands.urdf import FOUR, four_finger_hand
from tests.quick import every

TASK = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
BODIES = {
    "sphere": (ng.Sphere(0.03), mujoco.mjtGeom.mjGEOM_SPHERE, [0.03, 0, 0]),
    "box": (ng.Box([0.05, 0.04, 0.07]), mujoco.mjtGeom.mjGEOM_BOX, [0.025, 0.02, 0.035]),
    "cylinder": (ng.Cylinder(0.03, 0.08), mujoco.mjtGeom.mjGEOM_CYLINDER, [0.03, 0.04, 0]),
    "ellipsoid": (ng.Ellipsoid([0.04, 0.03, 0.02]), mujoco.mjtGeom.mjGEOM_ELLIPSOID, [0.04, 0.03, 0.02]),
}


def depths(hand, body, constraints=()):
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.5)] * hand.count, TASK, hand=hand, constraints=constraints)
    return PenetrationModel(problem, hand)


def posture(hand, seed, spread=0.04):
    rng = np.random.default_rng(seed)
    away = rng.uniform(0.0, spread) * rng.standard_normal((1, 3))
    return {name: v[0] for name, v in hand.draw(1, away, rng)[0].items()}


def mujoco_depth(hand, values, kind, size, path=FOUR):
    """Return the deepest penetration of the hand's geoms into a geom at the body frame's origin."""
    spec = mujoco.MjSpec.from_file(str(path))
    turn = Rotation.from_quat(values["palm_quaternion"], scalar_first=True)
    centre = -turn.as_matrix().T @ values["palm_position"]  # of the body, palm frame
    back = turn.inv().as_quat(scalar_first=True)
    spec.worldbody.add_geom(name="held", type=kind, size=size, pos=centre, quat=back)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in hand.tree.joint_positions(values["joints"]).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    held = model.geom("held").id
    between = np.zeros(6)
    geoms = [g for g in range(model.ngeom) if g != held]
    return max(0.0, *(-mujoco.mj_geomDistance(model, data, g, held, 0.5, between) for g in geoms))


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("seed", every(4, range(8)))
def test_depth_is_mujocos(name, seed):
    body, kind, size = BODIES[name]
    hand = four_finger_hand(self_collision=False)
    values = posture(hand, seed)
    penetration = depths(hand, body).in_posture(values)
    expected = mujoco_depth(hand, values, kind, size)
    assert penetration.depth <= expected + 3e-4
    assert (
        penetration.depth >= 0.7 * expected - 3e-4
    )  # of edges that cross MuJoCo's way out is longer, by up to 1 / 0.7
    assert (penetration.link is None) == (penetration.depth == 0.0)


def test_a_hand_far_away_is_not_deep():
    hand = four_finger_hand()
    values = {name: v[0] for name, v in hand.draw(1, np.array([[0.6, 0, 0]]), np.random.default_rng(0))[0].items()}
    penetration = depths(hand, ng.Box([0.05, 0.05, 0.05])).in_posture(values)
    assert (penetration.depth, penetration.link, penetration.is_free) == (0.0, None, True)


def test_hulls_of_concave_links_are_mujocos(tmp_path):
    """A finger like a fork, open along y: its hull is filled, itself it is not."""
    block, gap = trimesh.creation.box([0.02, 0.03, 0.06]), trimesh.creation.box([0.03, 0.016, 0.05])
    gap.apply_translation([0.0, 0.0, 0.02])
    trimesh.boolean.difference([block, gap], engine="manifold").export(tmp_path / "fork.stl")
    links = [
        f'<link name="f{i}"><collision><origin xyz="0 0 0.03"/><geometry><mesh filename="fork.stl"/></geometry>'
        f'</collision></link><joint name="j{i}" type="revolute"><parent link="palm"/><child link="f{i}"/>'
        f'<origin xyz="0 {y} 0"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i, y in ((1, -0.04), (2, 0.04))
    ]
    path = tmp_path / "forks.urdf"
    path.write_text(f'<robot name="forks"><link name="palm"/>{"".join(links)}</robot>')
    hand = ng.URDFHand.load(path, ["f1", "f2"], self_collision=False)
    body, kind, size = BODIES["box"]
    problem = ng.GraspProblem(body, [ng.SoftContact(0.5, 0.01)] * 2, TASK, hand=hand)
    hulls = PenetrationModel(problem, hand, parts=LinkParts(hand, hulls=True))
    shapes = PenetrationModel(problem, hand)
    differs = 0
    for seed in range(12):
        values = posture(hand, seed)
        depth, expected = hulls.in_posture(values).depth, mujoco_depth(hand, values, kind, size, path)
        assert depth == pytest.approx(expected, rel=0.1, abs=3e-4)  # directions are sampled: more matters when deep
        differs += shapes.in_posture(values).depth < depth - 1e-3
    assert differs >= 2
