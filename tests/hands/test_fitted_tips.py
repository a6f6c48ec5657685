"""Fingertips fitted to links: rounded convex hulls against brute force, and where they lie on box fingers and hands."""

import os
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.hands.fitted_tips import _LinkEnd, fit_hull_tips
from nlpgrasp.hands.inspection import inspect
from nlpgrasp.hands.opposition import opposition
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.suggested_tips import overhang
from nlpgrasp.hands.tips import SymbolicTouch, dome
from nlpgrasp.verify.numeric_urdf_hand import StatedTouch, touch_constraints
from tests.hands.described import FINGER, two_fingers
from tests.hands.robots import in_radians

VARIABLE = "NLPGRASP_TEST_DATA"
FILES = {
    "leap": "leap_hand/leap_hand_right.urdf",
    "barrett": "barrett_hand/bhand_model.urdf",
    "robotiq_3f": "robotiq_3f_gripper_visualization/cfg/robotiq-3f-gripper_articulated.urdf",
}
HALF = np.array([0.006, 0.009, 0.015])  # metres: half lengths of a box
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF + [0.001, -0.002, 0.03]
CLOUD = np.random.default_rng(7).uniform(-0.01, 0.01, (40, 3))
ROUNDING = 2e-4
TIPS = {
    "box": ng.HullTip(CORNERS, [0.0, 1.0, 1.0], 1.0, ROUNDING),
    "cloud": ng.HullTip(CLOUD, [0.3, -0.2, 1.0], np.pi, ROUNDING),
    "soft": ng.HullTip(CLOUD, [0.3, -0.2, 1.0], 0.5, 2e-3),
}


def unit_vectors(rng, count):
    directions = rng.standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def support(tip, directions):
    """Support function of the rounded hull at any vectors (m, 3), metres: |m| times the smooth maximum at m / |m|."""
    lengths = np.linalg.norm(directions, axis=1)
    heights = (directions / lengths[:, None]) @ np.asarray(tip.points).T
    highest = heights.max(axis=1)
    return lengths * (highest + tip.rounding * np.log(np.exp((heights - highest[:, None]) / tip.rounding).sum(axis=1)))


def touch_values(tip, pose, p, n):
    rows = tip.rows(SymbolicTouch("tip", 0, ca.DM(pose), ca.DM(p), ca.DM(n), None, 1.0))
    return {row.part: float(ca.evalf(ca.SX(row.expression))) for row in rows}, rows


def random_pose(rng):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3)
    return pose


@pytest.mark.parametrize("name", TIPS)
def test_support_exceeds_the_corners_by_at_most_the_rounding(name, rng):
    tip, normals = TIPS[name], unit_vectors(rng, 200)
    excess = np.sum(normals * tip.points_with_normals(normals), axis=1) - np.max(
        normals @ np.asarray(tip.points).T, axis=1
    )
    assert np.min(excess) > -1e-15
    assert np.max(excess) <= tip.rounding * np.log(len(tip.points))


def test_a_boxs_corner_edge_and_face_are_one_two_and_four_points():
    """Where k corners are equally high, the support exceeds them by exactly e log k."""
    normals = np.array([[1.0, 1.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = TIPS["box"].points_with_normals(normals)
    excess = np.sum(normals * points, axis=1) - np.max(normals @ CORNERS.T, axis=1)
    np.testing.assert_allclose(excess, ROUNDING * np.log([1, 2, 4]), atol=1e-12)
    middle = CORNERS.mean(axis=0)
    top = middle + np.array([0.0, 0.0, HALF[2] + ROUNDING * np.log(4)])
    np.testing.assert_allclose(points[2], top, atol=1e-12)


@pytest.mark.parametrize("name", TIPS)
def test_the_point_is_the_gradient_of_the_support_function(name, rng):
    tip, step = TIPS[name], 1e-7
    normals = unit_vectors(rng, 50)
    differences = [support(tip, normals + step * axis) - support(tip, normals - step * axis) for axis in np.eye(3)]
    np.testing.assert_allclose(np.column_stack(differences) / (2 * step), tip.points_with_normals(normals), atol=2e-7)


@pytest.mark.parametrize("name", TIPS)
def test_constraints_hold_at_that_point_alone_and_verify_has_the_same(name, rng):
    tip = TIPS[name]
    for m in unit_vectors(rng, 20):
        pose = random_pose(rng)
        p = pose[:3, :3] @ tip.points_with_normals(m[None])[0] + pose[:3, 3]
        n = pose[:3, :3] @ m
        values, rows = touch_values(tip, pose, p, n)
        assert max(abs(values[axis]) for axis in "xyz") < 1e-12
        assert values["within the patch"] == pytest.approx(m @ np.asarray(tip.facing), abs=1e-12)
        assert rows[-1].lower == pytest.approx(np.cos(tip.angle))
        off, _ = touch_values(tip, pose, p + np.array([0.0, 0.001, 0.0]), n)
        assert off["y"] == pytest.approx(-0.001, abs=1e-12)
        touch = StatedTouch("tip", pose, p, n, 1.0, 0.0, 0.0)
        twin = {row.name.split(", ")[-1]: row.value for row in touch_constraints(tip.to_dict(), touch)}
        assert twin.keys() == values.keys()
        np.testing.assert_allclose(list(twin.values()), list(values.values()), atol=1e-12)


def test_beyond_is_that_of_the_tangent_planes():
    tip = TIPS["box"]
    middle = CORNERS.mean(axis=0)
    probes = middle + np.outer([0.0, HALF[2] + 0.004, HALF[2] - 0.004], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(tip.beyond(probes), [-HALF[0], 0.004, -0.004], atol=2e-4)


def test_data_of_a_hull():
    tip = ng.HullTip(CORNERS, [0.0, 0.0, 2.0], 0.7, 1e-4)
    data = {"type": "hull", "points": CORNERS.tolist(), "facing": [0.0, 0.0, 1.0], "angle": 0.7, "rounding": 1e-4}
    assert tip.to_dict() == data


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (
            lambda: ng.HullTip([0.0, 0.0, 0.0], [0, 0, 1]),
            r"HullTip.points: got shape \(3,\), expected shape \(any, 3\)",
        ),
        (lambda: ng.HullTip(np.zeros((4, 2)), [0, 0, 1]), r"HullTip.points: got shape \(4, 2\)"),
        (lambda: ng.HullTip(np.zeros((0, 3)), [0, 0, 1]), "HullTip.points: got no points, expected one at least"),
        (lambda: ng.HullTip(CORNERS, [0, 0, 0]), "HullTip.facing: .*expected a direction"),
        (lambda: ng.HullTip(CORNERS, [0, 0, 1], rounding=0.0), "HullTip.rounding: got 0.0, expected a number greater"),
        (lambda: ng.HullTip(CORNERS, [0, 0, 1], rounding=-1e-4), "HullTip.rounding: got -0.0001, expected a number gr"),
        (lambda: ng.HullTip(CORNERS, [0, 0, 1], 4.0), "HullTip.angle"),
    ],
)
def test_hulls_that_are_none(make, match):
    with pytest.raises(ng.InputError, match=match):
        make()


def distance_from_box(points, middle, half):
    """Distance of points (m, 3) from the surface of a box, metres."""
    over = np.abs(points - middle) - half
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.where(outside > 0.0, outside, -np.max(over, axis=1))


@pytest.mark.parametrize("others", [(), ("f2",)], ids=["alone", "beside another"])
def test_fitted_to_a_box_finger(tmp_path, others):
    robot = read_robot(two_fingers(tmp_path))
    links = ["f1"] if others else ["f1", "f2"]
    for link, tip in fit_hull_tips(robot, links, others).items():
        side = 1.0 if link == "f1" else -1.0  # the other finger is towards +y of the first, -y of the second
        facing = np.asarray(tip.facing)
        assert side * facing[1] > 0.5
        assert facing[2] > 0.3
        assert np.degrees(tip.angle) > 20.0
        middle = np.array([0.0, -0.003 * side, 0.02])
        patch = tip.points_with_normals(dome(facing, tip.angle, 90).vertices)
        assert np.max(distance_from_box(patch, middle, np.array(FINGER) / 2.0)) < 3.5e-4
        assert overhang(tip, link, robot) < 3.5e-4
        assert patch[:, 2].max() == pytest.approx(0.04, abs=4e-4)  # the finger's end


def test_none_is_fitted_and_faces_stated_fingertips(tmp_path):
    path = two_fingers(tmp_path)
    fitted = ng.URDFHand.load(path, ["f1", "f2"]).tips[0][1]
    pad = ng.FlatTip([0.012, 0.03], [0.0, 0.0, 0.02], (np.pi / 2.0, 0.0, 0.0))
    beside = ng.URDFHand.load(path, {"f1": None, "f2": pad}).tips
    assert beside[0][1].points == fitted.points
    assert np.asarray(beside[0][1].facing)[1] > 0.5
    assert beside[1] == ("f2", pad)


def test_hollows_are_left_out_of_the_patch(tmp_path):
    """A fork of two prongs: the hull bridges the gap between them, and the patch keeps off the bridge."""
    prongs = [trimesh.creation.box([0.006, 0.006, 0.04]).apply_translation([0, y, 0.02]) for y in (-0.008, 0.008)]
    trimesh.util.concatenate(prongs).export(tmp_path / "fork.stl")
    path = two_fingers(tmp_path)
    box = f'<box size="{FINGER[0]} {FINGER[1]} {FINGER[2]}"/>'
    path.write_text(path.read_text().replace(box, '<mesh filename="fork.stl"/>'))
    robot = read_robot(path)
    for link, tip in fit_hull_tips(robot, ["f1", "f2"]).items():
        normals = dome(np.asarray(tip.facing), tip.angle, 200).vertices
        outside = [-shape.depth(tip.points_with_normals(normals)) for shape in robot.shapes[link]]
        assert np.max(np.min(outside, axis=0)) < 5e-4


def test_a_pad_in_front_of_a_wider_shape_carries_the_patch(tmp_path):
    """A pad 1 mm in front of the finger's box, which is longer: the patch is on the pad and includes its normal."""
    path = two_fingers(tmp_path, tip_frames=False)
    pad = '<collision><origin xyz="0 0 0.0185"/><geometry><box size="0.014 0.002 0.035"/></geometry></collision></link>'
    text = path.read_text()
    for link in ("f1", "f2"):
        head, tail = text.split(f'<link name="{link}">')
        text = f'{head}<link name="{link}">' + tail.replace("</link>", pad, 1)
    path.write_text(text)
    robot = read_robot(path)
    for (link, tip), side in zip(fit_hull_tips(robot, ["f1", "f2"]).items(), (1.0, -1.0), strict=True):
        normal = np.array([0.0, side, 0.0])
        assert normal @ np.asarray(tip.facing) >= np.cos(tip.angle)
        assert tip.points_with_normals(normal[None])[0, 1] == pytest.approx(side * 0.001, abs=3e-4)  # the pad's face
        assert overhang(tip, link, robot) < 1e-3


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
def test_pads_of_robosuites_rethink_gripper_carry_the_patches(tmp_path):
    """Two boxes a finger, one 0.2 mm in front of the other: the patches are wide and include the pads' normals."""
    hand = ng.URDFHand.load(in_radians("rethink_gripper.xml", tmp_path), ["l_finger_tip", "r_finger_tip"])
    for (_, tip), side in zip(hand.tips, (-1.0, 1.0), strict=True):
        assert np.degrees(tip.angle) > 20.0
        assert side * np.asarray(tip.facing)[1] >= np.cos(tip.angle)


@pytest.mark.slow
def test_fingers_of_robosuites_robotiq_140_face_each_other(tmp_path):
    """Its pads tilt towards each other as they close: the patches have the pad's front edge, and the tips meet."""
    hand = ng.URDFHand.load(
        in_radians("robotiq_gripper_140.xml", tmp_path), ["left_inner_finger", "right_inner_finger"]
    )
    (pair,) = opposition(hand.tree, hand.tree.joint_limits.mean(axis=0)).pairs
    assert pair.opposed < 0.015


def test_equal_fingers_are_fitted_once(tmp_path, monkeypatch):
    text = '<link name="palm"/>'
    for i in range(3):
        box = '<collision><origin xyz="0 0 0.02"/><geometry><box size="0.016 0.01 0.04"/></geometry></collision>'
        text += (
            f'<link name="f{i}">{box}</link><joint name="j{i}" type="revolute"><parent link="palm"/>'
            f'<child link="f{i}"/><origin xyz="0 0 0.02" rpy="0 0 {2.0 * np.pi * i / 3}"/><axis xyz="1 0 0"/>'
            '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
        )
    path = tmp_path / "three.urdf"
    path.write_text(f'<robot name="three">{text}</robot>')
    monkeypatch.setenv("NLPGRASP_CACHE", str(tmp_path / "cache"))
    fits, best_patch = [], _LinkEnd._best_patch
    monkeypatch.setattr(_LinkEnd, "_best_patch", lambda end, normals: fits.append(end) or best_patch(end, normals))
    tips = fit_hull_tips(read_robot(path), ["f0", "f1", "f2"])
    assert tips["f0"] == tips["f1"] == tips["f2"]
    assert len(fits) == 1
    assert fit_hull_tips(read_robot(path), ["f1", "f2"])["f1"] == tips["f1"]


@pytest.mark.slow
def test_a_bridged_hollow_is_no_warning_where_the_hand_is_inspected(tmp_path):
    """Load and inspection warn of the same overhangs: a hull from 2 mm on, any other fingertip from 1 mm on."""
    path, corners = two_fingers(tmp_path), trimesh.creation.box(FINGER).vertices + np.array([0.0, -0.003, 0.02])
    for extra, noticed in ((1.5e-3, False), (2.5e-3, True)):
        hull = ng.HullTip(corners + np.array([0.0, extra, 0.0]), [0.0, 1.0, 0.0], 0.5)
        with warnings.catch_warnings(record=True) as record:
            warnings.simplefilter("always")
            hand = ng.URDFHand.load(path, {"f1": hull, "f2": None})
        assert any("beyond the shapes" in str(warning.message) for warning in record) == noticed
        assert any("beyond the shapes" in finding.text for finding in inspect(hand).findings) == noticed


def test_a_link_without_a_shape_is_refused(tmp_path):
    path = two_fingers(tmp_path)
    path.write_text(path.read_text().replace("collision>", "bare>"))
    message = (
        r"^URDFHand.fingertips\['f1'\]: got a link without a collision shape, expected a radius or a tip, such as "
        r"ng.SphereTip\(0.01\)$"
    )
    with pytest.raises(ng.InputError, match=message):
        ng.URDFHand.load(path, {"f1": None, "f2": 0.01})


def write_pads_on_racks(folder, own_shapes=True):
    """Write two sliding carriages whose racks reach across to the other side, with pads fixed to them."""

    def box(size, at):
        return f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'

    text = f'<link name="palm">{box("0.09 0.09 0.05", "0 0 0")}</link>'
    for i, side in ((1, 1), (2, -1)):
        racks = "".join(box("0.08 0.012 0.006", f"{-0.04 * side} 0 {z}") for z in (0.0, 0.006))
        pad = box("0.004 0.05 0.028", f"{-0.002 * side} 0.025 0") if own_shapes else ""
        text += (
            f'<link name="carriage_{i}">{racks}{box("0.015 0.02 0.02", f"{-0.0075 * side} 0.005 0")}</link>'
            f'<link name="pad_{i}">{pad}</link><joint name="slide_{i}" type="prismatic"><parent link="palm"/>'
            f'<child link="carriage_{i}"/><origin xyz="{0.04 * side} 0.06 {0.015 * side}"/><axis xyz="{-side} 0 0"/>'
            '<limit lower="-0.02" upper="0.0245" effort="20" velocity="0.2"/></joint>'
            f'<joint name="fix_{i}" type="fixed"><parent link="carriage_{i}"/><child link="pad_{i}"/>'
            f'<origin xyz="{-0.011 * side} 0.03 {-0.015 * side}"/></joint>'
        )
    path = folder / "racks.urdf"
    path.write_text(f'<robot name="racks">{text}</robot>')
    return path


def test_the_named_link_is_fitted_and_not_what_is_fixed_to_it(tmp_path):
    hand = ng.URDFHand.load(write_pads_on_racks(tmp_path), ["pad_1", "pad_2"], approach=[0.0, 1.0, 0.0])
    for (_, tip), side in zip(hand.tips, (1, -1), strict=True):
        patch = tip.surface().vertices
        middle, half = np.array([-0.002 * side, 0.025, 0.0]), np.array([0.002, 0.025, 0.014])
        assert np.max(np.abs(distance_from_box(patch, middle, half))) < 1e-3
        assert -side * tip.facing[0] > 0.5


def test_shapes_fixed_to_a_link_without_its_own_serve_and_it_is_said(tmp_path):
    path = write_pads_on_racks(tmp_path, own_shapes=False)
    message = r"\['pad_2'\]: a link without a collision shape, fitted to those of carriage_2, fixed to it"
    with pytest.warns(UserWarning, match=message):
        ng.URDFHand.load(path, {"pad_1": 0.005, "pad_2": None}, tip_overhang=1.0)


def test_a_link_inside_another_that_is_fixed_to_it_is_refused(tmp_path):
    """A sensor in the finger: the finger touches, and not the sensor."""
    path = two_fingers(tmp_path)
    shape = '<collision><origin xyz="0 -0.003 0"/><geometry><box size="0.004 0.003 0.006"/></geometry></collision>'
    path.write_text(path.read_text().replace('<link name="t1"/>', f'<link name="t1">{shape}</link>'))
    message = (
        r"fingertips\['t1'\]: got a link whose collision shapes are inside those of links fixed to it, expected the"
    )
    with pytest.raises(ng.InputError, match=message):
        ng.URDFHand.load(path, ["t1", "f2"])


def preset(name):
    """Load a preset from the folder of outside hands; skip the test without it."""
    folder = os.environ.get(VARIABLE)
    path = Path(folder or ".") / "hands" / FILES[name]
    if folder is None or not path.is_file():
        pytest.skip(f"no {FILES[name]}: set {VARIABLE} to the folder that holds hands/")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return getattr(ng.hands, name)(path), path


@pytest.mark.parametrize("name", FILES)
def test_presets_touch_with_the_shapes_of_their_files(name):
    hand, _ = preset(name)
    for link, tip in hand.tips:
        assert tip.kind == "hull"
        assert overhang(tip, link, hand.robot) <= 4e-4
        assert np.degrees(tip.angle) > 20.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", ["leap", "barrett"])
def test_fitted_fingers_hold_a_cylinder(name, tmp_path):
    hand, path = preset(name)
    body = ng.Cylinder(0.03, 0.12)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size / 2.0] * 3])
    problem = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1, global_bound=False))
    assert solution.status is ng.Status.SOLVED
    assert solution.link_depth.depth <= 1e-3
    assert max(solution.hand["tip_gaps"]) <= 4e-4
    verification = ng.verify(solution.save(tmp_path / "grasp.json"), folders=[path.parent])
    assert verification.passed, str(verification)
