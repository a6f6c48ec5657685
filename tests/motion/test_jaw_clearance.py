"""Exact clearance of a gripper's boxes, compared with dense samples and with distances known by construction."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.meshes.box_distance import box_distance, least_box_distance
from nlpgrasp.motion.jaw_clearance import JawClearance, surface_triangles

GRIPPER = ng.ParallelJaw(stroke=0.1, pad=(0.02, 0.012), finger=(0.06, 0.01, 0.016), palm_size=(0.14, 0.06, 0.08))
CUBE = ng.Box([0.03, 0.03, 0.03])
ACROSS = np.array([[-0.015, 0.0, 0.0], [0.015, 0.0, 0.0]])
DOWN = np.array([0.0, 0.0, -1.0])


def cleared(constraints=(), body=CUBE, gripper=GRIPPER):
    return JawClearance(gripper, body, constraints)


@pytest.mark.parametrize("seed", range(5))
def test_least_distance_of_triangles_from_a_box_by_samples(seed):
    rng = np.random.default_rng(seed)
    lower, upper = np.array([-0.01, -0.006, -0.05]), np.array([0.002, 0.006, 0.01])
    triangles = 0.02 * rng.normal(size=(40, 1, 3)) + 0.01 * rng.normal(size=(40, 3, 3))
    weights = rng.dirichlet([1, 1, 1], 20000)
    sampled = float(box_distance(np.einsum("mi,tij->tmj", weights, triangles), lower, upper).min())
    least = least_box_distance(triangles, lower, upper)
    assert least <= sampled + max(2e-5, 0.05 * abs(sampled))
    assert least >= sampled - max(1e-3, 0.06 * abs(sampled))  # what 20,000 samples of a triangle can miss


def test_a_face_that_a_finger_lies_on_is_touched_and_not_entered():
    corners, _ = surface_triangles(CUBE)
    assert least_box_distance(corners, np.array([0.015, -0.1, -0.1]), np.array([0.03, 0.1, 0.1])) == pytest.approx(0.0)


def test_a_free_pose_states_its_clearance_and_frame():
    """Above a table 25 mm below the middle: the pads reach 10 mm beyond the contacts, so 15 mm are left."""
    pose = cleared([ng.Table(-0.025)]).pose(ACROSS, DOWN)
    assert pose.is_free
    assert pose.clearance == pytest.approx(0.015 - 5e-4, abs=3e-5)
    assert (pose.opening, pose.opened) == pytest.approx((0.03, 0.1))
    np.testing.assert_allclose(pose.matrix @ [0.0, 0.0, 0.06, 1.0], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(pose.matrix[:3, 2], DOWN, atol=1e-12)


def test_a_table_too_near_blocks_by_its_depth():
    pose = cleared([ng.Table(-0.015, clearance=0.0)]).pose(ACROSS, np.array([0.0, 1.0, 0.0]))
    assert pose.blocked_by == pytest.approx({"the table": 0.03 - 0.015})  # half the palm's 60 mm


def test_an_obstacle_beside_the_part_is_passed_less_open():
    """A wall 18 mm beside a contact: fully open, a finger would close through it; opened by 10 mm it fits."""
    wall = ng.Obstacle(ng.Box([0.01, 0.2, 0.05]), 0.001, [0.038, 0.0, 0.0], name="wall")
    pose = cleared([wall]).pose(ACROSS, DOWN)
    assert pose.is_free
    assert pose.opened == pytest.approx(0.04)
    near = ng.Obstacle(ng.Box([0.01, 0.2, 0.05]), 0.001, [0.029, 0.0, 0.0], name="wall")
    assert list(cleared([near]).pose(ACROSS, DOWN).blocked_by) == ["wall"]


def test_a_finger_inside_an_obstacle_altogether_is_blocked():
    around = ng.Obstacle(ng.Box([0.5, 0.5, 0.5]), 0.0, [0.0, 0.4, 0.0], name="block")
    pose = cleared([around]).pose(ACROSS + np.array([0.0, 0.4, 0.0]), DOWN)
    assert "block" in pose.blocked_by


def test_turns_slides_and_their_order():
    clearance = cleared([ng.Table.under(CUBE, 0.001)])
    poses = clearance.poses(ACROSS, 12, (0.0, 0.005))
    assert len(poses) == 24
    assert [pose.is_free for pose in poses] == sorted((pose.is_free for pose in poses), reverse=True)
    angles = {round(np.degrees(pose.turn)) for pose in poses}
    assert len(angles) == 12
    slid = next(pose for pose in poses if pose.slide)
    contact = (ACROSS.mean(axis=0) - slid.position) @ slid.rotation
    assert contact[2] == pytest.approx(0.06 - 0.005)


def test_curved_bodies_lose_what_their_triangles_are_off():
    """A finger 5 mm beside a sphere."""
    sphere = ng.Sphere(0.015)
    _, roughness = surface_triangles(sphere)
    assert 0.0 < roughness < 5e-4
    fingers = np.array([[[0.02, -0.005, -0.05], [0.03, 0.005, 0.05]]])
    (distance,) = cleared(body=sphere).solids[0].distances(fingers, np.eye(3), np.zeros(3))
    assert 0.005 - roughness <= distance <= 0.005 + 2e-5


@pytest.mark.parametrize(
    ("field", "value"), [("pad", (0.02,)), ("pad", (0.02, 0.0)), ("finger", (0.1, 0.01)), ("palm_size", (0.1, -1, 1))]
)
def test_sizes_that_no_gripper_has_are_refused(field, value):
    with pytest.raises(ng.InputError, match=rf"ParallelJaw\.{field}"):
        ng.ParallelJaw(0.1, **{field: value})


def test_the_sizes_come_back_from_a_file():
    data = GRIPPER.to_dict()
    assert ng.ParallelJaw.from_dict(data) == GRIPPER
    assert (data["opening"], data["finger_length"], data["finger_thickness"]) == (0.1, 0.06, 0.01)


@pytest.mark.parametrize("seed", range(4))
def test_the_share_of_a_pad_by_rays(seed):
    """Random places on a plate with a hole of 8 mm: rays of a grid that meet the plate within 3 mm."""
    rng = np.random.default_rng(seed)
    plate = trimesh.creation.box([0.06, 0.008, 0.05])
    hole = trimesh.creation.cylinder(
        0.004, 0.02, transform=trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    )
    mesh = ng.Mesh(trimesh.boolean.difference([plate, hole]))
    x, z, turn = *rng.uniform(-0.02, 0.02, 2), rng.uniform(0.0, 2.0 * np.pi)
    points = np.array([[x, -0.004, z], [x, 0.004, z]])
    direction = np.array([np.sin(turn), 0.0, np.cos(turn)])
    shares = cleared(body=mesh).pad_shares(points, direction[None])[0]
    a, b = (s.ravel() for s in np.meshgrid(np.linspace(-1, 1, 201) * 0.01, np.linspace(-1, 1, 121) * 0.006))
    samples = np.array([x, z]) + a[:, None] * direction[[0, 2]] + b[:, None] * direction[[2, 0]] * [1.0, -1.0]
    is_on = np.all(np.abs(samples) <= [0.03, 0.025], axis=1) & (np.linalg.norm(samples, axis=1) >= 0.004)
    assert shares == pytest.approx([is_on.mean()] * 2, abs=0.01)


@pytest.mark.parametrize(
    ("contact", "depth"),
    [(ng.SoftContact(0.5, 0.004), 3e-3), (ng.PlaneContact(extents=(0.02, 0.012), friction=0.5, direction=DOWN), 5e-4)],
)
def test_a_curved_face_counts_as_far_as_it_is_near_the_pad(contact, depth):
    """On a cylinder of radius r the surface is d behind the pad at sqrt(2 r d - d^2) beside its middle."""
    cylinder, radius = ng.Cylinder(0.006, 0.08), 0.006
    points = np.array([[-radius, 0.0, 0.0], [radius, 0.0, 0.0]])
    (share, _) = JawClearance(GRIPPER, cylinder, (), [contact] * 2).pad_shares(points, np.array([DOWN]))[0]
    assert share == pytest.approx(np.sqrt(2 * radius * depth - depth**2) / 0.006, rel=0.01)
