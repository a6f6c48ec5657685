"""Penetration depths of links in each other: against MuJoCo's distances, and as ``verify`` recomputes them."""

from itertools import combinations

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.verify.numeric_urdf_hand import NumericLinkedHand
from nlpgrasp.verify.self_penetration import NumericSelfPenetration
from nlpgrasp.verify.sources import SourceFolders
from tests.hands.urdf import FOLDER, FOUR, four_finger_hand
from tests.quick import every

SEEDS = (0, 1, 8, 10, 12, 18, 25, 41, 62, 117)  # random postures, two of them free, the others 0.5 to 18 mm deep
TASK = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
FAR = {"palm_position": np.array([5.0, 0.0, 0.0]), "palm_quaternion": np.array([1.0, 0.0, 0.0, 0.0])}


def depth_model(hand):
    contacts = [ng.FrictionContact(0.5)] * hand.count
    return PenetrationModel(ng.GraspProblem(ng.Sphere(0.03), contacts, TASK, hand=hand), hand)


@pytest.fixture(scope="module")
def model():
    return depth_model(four_finger_hand())


def posture(hand, seed):
    lower, upper = hand.tree.joint_limits
    return {**FAR, "joints": np.random.default_rng(seed).uniform(lower, upper)}


def mujoco_depth(hand, joints):
    """Return the deepest penetration of two geoms of links with more than one moving joint between them."""
    model = mujoco.MjModel.from_xml_path(str(FOUR))
    data = mujoco.MjData(model)
    for name, value in hand.tree.joint_positions(joints).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    weld = model.body_weldid  # MuJoCo joins bodies that no joint moves
    parents = {weld[body]: weld[model.body_parentid[weld[body]]] for body in range(model.nbody)}
    between, deepest = np.zeros(6), 0.0
    for a, b in combinations(range(model.ngeom), 2):
        i, j = (weld[model.geom_bodyid[g]] for g in (a, b))
        if i != j and parents[i] != j and parents[j] != i:
            deepest = max(deepest, -mujoco.mj_geomDistance(model, data, a, b, 0.5, between))
    return deepest


@pytest.mark.parametrize("seed", SEEDS)
def test_depth_of_links_in_each_other_is_mujocos(model, seed):
    values = posture(model.hand, seed)
    penetration = model.in_posture(values)
    assert penetration.depth == pytest.approx(mujoco_depth(model.hand, values["joints"]), rel=0.02, abs=1e-4)
    assert (penetration.depth > 0.0) == (seed > 1)
    if penetration.depth:
        assert penetration.other_link in model.hand.robot.shapes
        assert f"link {penetration.link} is " in penetration.words
        assert penetration.words.endswith(f"mm inside link {penetration.other_link}")


def numeric_hand(hand, seed):
    return NumericLinkedHand(hand.to_dict(), hand.describe(posture(hand, seed)), {}, SourceFolders((FOLDER,)))


@pytest.fixture(scope="module")
def numeric_model(model):
    numeric = numeric_hand(model.hand, SEEDS[0])
    samples = {link: np.concatenate([shape.vertices for shape in shapes]) for link, shapes in numeric.shapes.items()}
    return NumericSelfPenetration(numeric, samples)


@pytest.mark.parametrize("seed", every(2, SEEDS))
def test_verify_finds_the_same_depth(model, numeric_model, seed):
    values = posture(model.hand, seed)
    found = numeric_model.in_posture(numeric_hand(model.hand, seed), 1e-3)
    assert found.depth == pytest.approx(model.in_posture(values).depth, rel=0.1, abs=3e-4)


def test_a_hand_without_self_collision_is_not_measured():
    hand = four_finger_hand(self_collision=False)
    model = depth_model(hand)
    assert all(model.in_posture(posture(hand, seed)).depth == 0.0 for seed in SEEDS)
    assert hand.to_dict()["self_collision"] is False


STACK = """<robot name="stack">
<link name="palm"><collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision></link>
<link name="knuckle"/>
<link name="finger">
<collision><origin xyz="0 0 0.03"/><geometry><box size="0.004 0.004 0.08"/></geometry></collision></link>
<link name="tip"/>
<joint name="a" type="revolute"><parent link="palm"/><child link="knuckle"/><origin xyz="0 0 0.025"/>
<axis xyz="1 0 0"/><limit lower="-0.3" upper="0.3" effort="1" velocity="1"/></joint>
<joint name="b" type="revolute"><parent link="knuckle"/><child link="finger"/>
<axis xyz="0 1 0"/><limit lower="-{range}" upper="{range}" effort="1" velocity="1"/></joint>
<joint name="c" type="fixed"><parent link="finger"/><child link="tip"/><origin xyz="0 0 0.07"/></joint>
</robot>"""


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("turn", "depth"), [(0.3, 0.0), (3.0, 5e-3)])
def test_links_that_overlap_by_construction_are_left_out(tmp_path, turn, depth):
    """The finger's root reaches 5 mm into the palm: wherever a little turn takes it, but not where it lies flat."""
    path = tmp_path / "stack.urdf"
    path.write_text(STACK.format(range=turn))
    model = depth_model(ng.URDFHand.load(path, {"tip": 0.005}))
    assert model.in_posture({**FAR, "joints": np.zeros(2)}).depth == pytest.approx(depth, abs=1e-5)
