"""Clearance bounds between postures against dense sampling; distance fields against closed forms."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.distance_fields import build_distance_fields
from tests.hands.urdf import GRIPPER, PADS
from tests.quick import every
from tests.studies.two_fingers import DOWN, TIP, box_distance, chain, in_body, two_fingers

BODY = ng.Box([0.06, 0.2, 0.06])


def clearance_model(hand, constraints=()):
    contacts = [ng.FrictionContact(0.5)] * hand.count
    return HandClearance(ng.GraspProblem(BODY, contacts, ng.TaskEllipsoid([1.0] * 6), hand, constraints), hand)


def values(rng, hand):
    lower, upper = hand.tree.joint_limits
    return {
        "palm_position": rng.normal(size=3) * 0.05,
        "palm_quaternion": DOWN,
        "joints": rng.uniform(lower, upper),
    }


@pytest.mark.parametrize("seed", every(3, range(11)))
def test_no_clearance_between_two_postures_is_below_its_bound(tmp_path, seed):
    hand, rng = two_fingers(tmp_path), np.random.default_rng(seed)
    post = ng.Obstacle(ng.Sphere(0.01), position=[0.02, 0.0, 0.1])
    model = clearance_model(hand, [ng.Table(-0.05), post])
    a = values(rng, hand)
    size = 10.0 ** rng.uniform(-3, 0)
    b = {k: v + (0.0 if k == "palm_quaternion" else size * rng.normal(size=len(v))) for k, v in a.items()}
    b["palm_position"] = a["palm_position"] + 0.02 * size * rng.normal(size=3)
    bound = model.clearance_bounds(a, b, (model.clearances(a), model.clearances(b)))
    for t in np.linspace(0.0, 1.0, 60):
        between = {k: a[k] + t * (b[k] - a[k]) for k in a}
        assert np.min(model.clearances(between) - bound) > -1e-9
    assert_path_lengths(model, a, b)


def assert_path_lengths(model, a, b):
    """Points of the parts move no farther than the bound, along a path of 200 steps."""
    frames = model.parts.frames_of([{k: a[k] + t * (b[k] - a[k]) for k in a} for t in np.linspace(0.0, 1.0, 200)])
    for part, bound in enumerate(model.path_length_bounds(a, b)):
        points = [model.parts.points(part, frame[part]) for frame in frames]
        lengths = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=2), axis=0)
        assert np.max(lengths) <= bound + 1e-12


def test_sliding_joints_and_joints_that_follow_count(tmp_path):
    hand = ng.URDFHand.load(GRIPPER, PADS)
    model = clearance_model(hand)
    rng = np.random.default_rng(0)
    for _ in range(5):
        a, b = values(rng, hand), values(rng, hand)
        b["palm_position"] = a["palm_position"]
        assert_path_lengths(model, a, b)
        assert np.max(model.path_length_bounds(a, b)) > 0.0


def test_clearances_are_those_of_balls_that_are_placed_by_hand(tmp_path):
    hand, rng = two_fingers(tmp_path), np.random.default_rng(1)
    table = ng.Table(-0.05, clearance=0.002)
    turn = [np.cos(0.3), 0.0, 0.0, np.sin(0.3)]
    slab = ng.Obstacle(ng.Box([0.02, 0.03, 0.04]), 0.003, [0.1, 0.02, 0.0], turn, name="slab")
    model = clearance_model(hand, [ng.Spread(max=0.3), table, slab])
    assert [f.name for f in model.fields] == ["the body", "table", "slab"]
    posture = values(rng, hand)
    q = dict(zip([j.name for j in hand.robot.free_joints], posture["joints"], strict=True))
    positions = {"palm": in_body(np.zeros(3), posture["palm_position"])}
    for name in "ab":
        chain_points = in_body(chain(name, [q[f"{name}{i}_joint"] for i in range(3)]), posture["palm_position"])
        positions |= {f"{name}{i}": p for i, p in enumerate(chain_points[:3])} | {f"{name}_tip": chain_points[3]}
    radius = {link: 0.012 if link == "palm" else TIP if link.endswith("tip") else 0.004 for link in positions}
    c, s = np.cos(0.6), np.sin(0.6)
    local = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    clearances = {model.describe_clearance(i): value for i, value in enumerate(model.clearances(posture))}
    for link, p in positions.items():
        name = f"fingertip {link}" if link.endswith("tip") else f"link {link}"
        r = radius[link]
        assert clearances[f"{name} against table"] == pytest.approx(p[2] - r - (-0.05 + 0.002), abs=1e-9)
        gap = box_distance(p, np.array([0.03, 0.1, 0.03])) - r
        assert clearances[f"{name} against the body"] == pytest.approx(gap, abs=1e-9)
        inside = local @ (p - [0.1, 0.02, 0.0])
        gap = box_distance(inside, np.array([0.01, 0.015, 0.02])) - r - 0.003
        assert clearances[f"{name} against slab"] == pytest.approx(gap, abs=1e-9)
    gap_between = np.linalg.norm(positions["a2"] - positions["b_tip"]) - radius["a2"] - radius["b_tip"]
    assert clearances["link a2 against fingertip b_tip"] == pytest.approx(gap_between, abs=1e-9)
    assert not any("link a0 against link a1" in words for words in clearances)


def test_constraints_on_grasps_are_in_nobodys_way():
    constraints = [ng.Spread(max=0.1), ng.Workspace(ng.BoxRegion([-1.0] * 3, [1.0] * 3)), ng.Forbid("+z")]
    assert [f.name for f in build_distance_fields(BODY, constraints, 3)] == ["the body"]
    two = [ng.Obstacle(ng.Sphere(0.1)), ng.Obstacle(ng.Sphere(0.2)), ng.Table(0.0)]
    assert [f.name for f in build_distance_fields(BODY, two, 3)] == ["the body", "obstacle", "obstacle 2", "table"]
    np.testing.assert_allclose(
        build_distance_fields(BODY, two, 3)[2].distance(np.array([[0.5, 0.0, 0.0]])), 0.3, atol=1e-9
    )


def test_planar_obstacles():
    square = ng.Polygon([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    fields = build_distance_fields(square, [ng.Table(-0.5, clearance=0.0)], 2)
    np.testing.assert_allclose(fields[1].distance(np.array([[0.3, 0.0], [0.0, -1.0]])), [0.5, -0.5])
